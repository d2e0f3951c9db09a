//! The MQ arithmetic decoder (ISO/IEC 15444-1 Annex C), and raw bits of the bypass mode (D.6).

/// Probability estimates (Table C.2): Qe, next state after the more and the less probable symbol, and
/// whether the sense is switched.
#[rustfmt::skip]
const STATES: [(u16, u8, u8, bool); 47] = [
    (0x5601, 1, 1, true), (0x3401, 2, 6, false), (0x1801, 3, 9, false), (0x0AC1, 4, 12, false),
    (0x0521, 5, 29, false), (0x0221, 38, 33, false), (0x5601, 7, 6, true), (0x5401, 8, 14, false),
    (0x4801, 9, 14, false), (0x3801, 10, 14, false), (0x3001, 11, 17, false), (0x2401, 12, 18, false),
    (0x1C01, 13, 20, false), (0x1601, 29, 21, false), (0x5601, 15, 14, true), (0x5401, 16, 14, false),
    (0x5101, 17, 15, false), (0x4801, 18, 16, false), (0x3801, 19, 17, false), (0x3401, 20, 18, false),
    (0x3001, 21, 19, false), (0x2801, 22, 19, false), (0x2401, 23, 20, false), (0x2201, 24, 21, false),
    (0x1C01, 25, 22, false), (0x1801, 26, 23, false), (0x1601, 27, 24, false), (0x1401, 28, 25, false),
    (0x1201, 29, 26, false), (0x1101, 30, 27, false), (0x0AC1, 31, 28, false), (0x09C1, 32, 29, false),
    (0x08A1, 33, 30, false), (0x0521, 34, 31, false), (0x0441, 35, 32, false), (0x02A1, 36, 33, false),
    (0x0221, 37, 34, false), (0x0141, 38, 35, false), (0x0111, 39, 36, false), (0x0085, 40, 37, false),
    (0x0049, 41, 38, false), (0x0025, 42, 39, false), (0x0015, 43, 40, false), (0x0009, 44, 41, false),
    (0x0005, 45, 42, false), (0x0001, 45, 43, false), (0x5601, 46, 46, false),
];

/// Contexts: nine of significance, five of sign, three of refinement, run length, uniform.
pub(super) const CONTEXTS: usize = 19;
pub(super) const RUN_LENGTH: usize = 17;
pub(super) const UNIFORM: usize = 18;

/// Adaptive state of all contexts: index into [`STATES`] times two, plus the more probable symbol.
#[derive(Clone)]
pub(super) struct Contexts([u8; CONTEXTS]);

impl Contexts {
    /// The states at the start of a code-block (Table D.7).
    pub(super) fn new() -> Self {
        let mut states = [0; CONTEXTS];
        states[0] = 4 << 1;
        states[RUN_LENGTH] = 3 << 1;
        states[UNIFORM] = 46 << 1;
        Self(states)
    }
}

/// Decodes one terminated segment of a code-block.
pub(super) struct Decoder<'a> {
    bytes: &'a [u8],
    at: usize,
    code: u32,
    interval: u32,
    count: u32,
}

impl<'a> Decoder<'a> {
    pub(super) fn new(bytes: &'a [u8]) -> Self {
        let mut decoder = Self { bytes, at: 0, code: 0, interval: 0x8000, count: 0 };
        decoder.code = u32::from(decoder.byte(0)) << 16;
        decoder.byte_in();
        decoder.code <<= 7;
        decoder.count -= 7;
        decoder
    }

    /// Past the end come ones, as if a marker followed.
    fn byte(&self, at: usize) -> u8 {
        self.bytes.get(at).copied().unwrap_or(0xFF)
    }

    fn byte_in(&mut self) {
        let next = self.byte(self.at + 1);
        if self.byte(self.at) == 0xFF {
            if next > 0x8F {
                self.code += 0xFF00;
                self.count = 8;
            } else {
                self.at += 1;
                self.code += u32::from(next) << 9;
                self.count = 7;
            }
        } else {
            self.at += 1;
            self.code += u32::from(next) << 8;
            self.count = 8;
        }
    }

    fn renormalize(&mut self) {
        loop {
            if self.count == 0 {
                self.byte_in();
            }
            self.interval <<= 1;
            self.code <<= 1;
            self.count -= 1;
            if self.interval & 0x8000 != 0 {
                break;
            }
        }
    }

    #[inline]
    pub(super) fn decide(&mut self, contexts: &mut Contexts, context: usize) -> bool {
        let state = &mut contexts.0[context];
        let (estimate, next_more, next_less, switch) = STATES[usize::from(*state >> 1)];
        let estimate = u32::from(estimate);
        let more = *state & 1;
        self.interval -= estimate;
        let upper = (self.code >> 16) < estimate;
        if !upper {
            self.code -= estimate << 16;
            if self.interval & 0x8000 != 0 {
                return more != 0;
            }
        }
        // The smaller part is the less probable symbol's, whichever side it lies on (C.3.2).
        let is_more = (self.interval < estimate) == upper;
        if upper {
            self.interval = estimate;
        }
        let symbol = if is_more {
            *state = next_more << 1 | more;
            more
        } else {
            *state = next_less << 1 | (more ^ u8::from(switch));
            more ^ 1
        };
        self.renormalize();
        symbol != 0
    }
}

/// Raw bits, most significant first; a byte after 0xFF has seven. Ones past the end, where encoders leave them out.
pub(super) struct RawBits<'a> {
    bytes: &'a [u8],
    at: usize,
    current: u8,
    left: u32,
}

impl<'a> RawBits<'a> {
    pub(super) fn new(bytes: &'a [u8]) -> Self {
        Self { bytes, at: 0, current: 0, left: 0 }
    }

    pub(super) fn bit(&mut self) -> bool {
        if self.left == 0 {
            self.left = if self.current == 0xFF { 7 } else { 8 };
            self.current = self.bytes.get(self.at).copied().unwrap_or(0xFF);
            self.at = self.at.saturating_add(1);
        }
        self.left -= 1;
        self.current >> self.left & 1 != 0
    }
}
