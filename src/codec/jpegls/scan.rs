//! Samples of one scan: context modelling, prediction and runs (T.87 annex A).

use super::parameters::Parameters;
use super::stream::{Stream, ends_early};
use crate::codec::{CodecError, damaged};

/// Contexts of gradients; the quantised gradients of a sample and their negation share one.
const REGULAR_CONTEXTS: usize = (9 * 9 * 9 - 1) / 2 + 1;

/// Log2 of the length of a run segment, indexed by the state of the runs before (J of T.87 section A.2.1).
pub(super) const RUN_ORDERS: [u8; 32] =
    [0, 0, 0, 0, 1, 1, 1, 1, 2, 2, 2, 2, 3, 3, 3, 3, 4, 4, 5, 5, 6, 6, 7, 7, 8, 9, 10, 11, 12, 13, 14, 15];

/// Statistics of the prediction errors of one context (A, B, C, N of T.87).
#[derive(Clone, Copy)]
struct Context {
    /// Sum of the errors' magnitudes.
    magnitude: u32,
    /// Sum of the errors.
    bias: i32,
    /// The correction of the prediction.
    correction: i32,
    /// Samples seen.
    count: u32,
}

/// Statistics of the samples that end a run (A, N, Nn of T.87).
#[derive(Clone, Copy)]
struct RunContext {
    magnitude: u32,
    count: u32,
    /// Errors below zero.
    negative: u32,
}

/// Two lines of one component, each with a sample added at either end.
pub(super) struct Lines {
    above: Vec<u16>,
    current: Vec<u16>,
    /// Quantised difference between each sample above and its left neighbour.
    steps: Vec<i8>,
    run_index: usize,
}

pub(super) fn line_bytes(columns: u32) -> u64 {
    (u64::from(columns) + 2) * (2 + 2 + 1)
}

impl Lines {
    /// Lines of zeros, which stand above the first one.
    pub(super) fn new(columns: usize) -> Lines {
        Lines {
            above: vec![0; columns + 2],
            current: vec![0; columns + 2],
            steps: vec![0; columns + 1],
            run_index: 0,
        }
    }

    pub(super) fn samples(&self) -> &[u16] {
        &self.current[1..self.current.len() - 1]
    }

    /// Back to the initial state: zeros above, and no runs counted.
    fn reset(&mut self) {
        self.above.fill(0);
        self.current.fill(0);
        self.run_index = 0;
    }
}

pub(super) struct Coder {
    parameters: Parameters,
    contexts: Box<[Context; REGULAR_CONTEXTS]>,
    /// Contexts of the end of a run: between unlike neighbours, and between like ones.
    run_contexts: [RunContext; 2],
}

impl Coder {
    pub(super) fn new(parameters: &Parameters) -> Coder {
        let (context, run) = initial(parameters);
        Coder {
            parameters: *parameters,
            contexts: Box::new([context; REGULAR_CONTEXTS]),
            run_contexts: [run; 2],
        }
    }

    /// Forgets everything, as a restart marker asks.
    pub(super) fn reset(&mut self, lines: &mut [Lines]) {
        let (context, run) = initial(&self.parameters);
        self.contexts.fill(context);
        self.run_contexts = [run; 2];
        lines.iter_mut().for_each(Lines::reset);
    }

    /// Decodes the next line of one component.
    pub(super) fn line(&mut self, stream: &mut Stream<'_>, lines: &mut Lines) -> Result<(), CodecError> {
        self.turn(lines);
        if self.parameters.near == 0 {
            self.line_of::<true>(stream, lines)
        } else {
            self.line_of::<false>(stream, lines)
        }
    }

    /// Decodes the next line of all components, sample by sample.
    pub(super) fn pixels(&mut self, stream: &mut Stream<'_>, lines: &mut [Lines]) -> Result<(), CodecError> {
        for component in lines.iter_mut() {
            self.turn(component);
        }
        if self.parameters.near == 0 {
            self.pixels_of::<true>(stream, lines)
        } else {
            self.pixels_of::<false>(stream, lines)
        }
    }

    /// The current line becomes the one above, and the samples left and right of the lines are set.
    fn turn(&self, lines: &mut Lines) {
        std::mem::swap(&mut lines.above, &mut lines.current);
        let last = lines.above.len() - 1;
        // The sample left of the line above keeps its value from when that line was decoded.
        lines.above[last] = lines.above[last - 1];
        lines.current[0] = lines.above[1];
        for (step, pair) in lines.steps.iter_mut().zip(lines.above.windows(2)) {
            *step = quantise(&self.parameters, i32::from(pair[1]) - i32::from(pair[0]));
        }
    }

    fn line_of<const LOSSLESS: bool>(
        &mut self,
        stream: &mut Stream<'_>,
        lines: &mut Lines,
    ) -> Result<(), CodecError> {
        let parameters = self.parameters;
        let Lines { above, current, steps, run_index } = lines;
        let columns = steps.len() - 1;
        let mut x = 1;
        while x <= columns {
            let (left, corner, up) = (current[x - 1], above[x - 1], above[x]);
            let context = context(&parameters, steps[x - 1], steps[x], left, corner);
            if context != 0 {
                current[x] = self.sample::<LOSSLESS>(stream, context, [left, up, corner])?;
                x += 1;
                continue;
            }
            let run = run_length(stream, run_index, columns + 1 - x)?;
            current[x..x + run].fill(left);
            x += run;
            if x <= columns {
                let up = above[x];
                let alike = i32::from(left).abs_diff(i32::from(up)) <= parameters.near.unsigned_abs();
                let error = self.run_end(stream, alike, RUN_ORDERS[*run_index])?;
                *run_index = run_index.saturating_sub(1);
                current[x] = if alike {
                    reconstruct::<LOSSLESS>(&parameters, i32::from(left), error)
                } else {
                    let error = if left > up { -error } else { error };
                    reconstruct::<LOSSLESS>(&parameters, i32::from(up), error)
                };
                x += 1;
            }
        }
        Ok(())
    }

    fn pixels_of<const LOSSLESS: bool>(
        &mut self,
        stream: &mut Stream<'_>,
        lines: &mut [Lines],
    ) -> Result<(), CodecError> {
        let parameters = self.parameters;
        // Runs are of whole pixels: the first component holds the run index of all.
        let Some(mut run_index) = lines.first().map(|first| first.run_index) else { return Ok(()) };
        let columns = lines.first().map_or(0, |first| first.steps.len() - 1);
        let mut x = 1;
        while x <= columns {
            let mut contexts = [0; 4];
            for (found, component) in contexts.iter_mut().zip(&*lines) {
                let (left, corner) = (component.current[x - 1], component.above[x - 1]);
                *found = context(&parameters, component.steps[x - 1], component.steps[x], left, corner);
            }
            if contexts != [0; 4] {
                for (&context, component) in contexts.iter().zip(&mut *lines) {
                    let near = [component.current[x - 1], component.above[x], component.above[x - 1]];
                    component.current[x] = self.sample::<LOSSLESS>(stream, context, near)?;
                }
                x += 1;
                continue;
            }
            let run = run_length(stream, &mut run_index, columns + 1 - x)?;
            for component in &mut *lines {
                let left = component.current[x - 1];
                component.current[x..x + run].fill(left);
            }
            x += run;
            if x <= columns {
                for component in &mut *lines {
                    let (left, up) = (component.current[x - 1], component.above[x]);
                    // Like neighbours have no separate context in this mode.
                    let error = self.run_end(stream, false, RUN_ORDERS[run_index])?;
                    let error = if left > up { -error } else { error };
                    component.current[x] = reconstruct::<LOSSLESS>(&parameters, i32::from(up), error);
                }
                run_index = run_index.saturating_sub(1);
                x += 1;
            }
        }
        if let Some(first) = lines.first_mut() {
            first.run_index = run_index;
        }
        Ok(())
    }

    /// A sample outside runs (T.87 sections A.4 to A.6), from its neighbours left, above and above left.
    #[inline]
    fn sample<const LOSSLESS: bool>(
        &mut self,
        stream: &mut Stream<'_>,
        context: i32,
        [left, up, corner]: [u16; 3],
    ) -> Result<u16, CodecError> {
        let parameters = &self.parameters;
        let state = &mut self.contexts[context.unsigned_abs() as usize];
        let negated = context < 0;
        let correction = if negated { -state.correction } else { state.correction };
        let predicted = (predict(left, up, corner) + correction).clamp(0, parameters.maximum);
        let k = golomb_order(state.count, state.magnitude);
        let code = stream.golomb(k, parameters.limit - parameters.error_bits - 1, parameters.error_bits)?;
        let code = checked(parameters, code)?;
        let mut error = (code >> 1) ^ -(code & 1);
        if LOSSLESS && k == 0 && 2 * state.bias <= -state.count.cast_signed() {
            error = !error;
        }
        // Sections A.6.1 and A.6.2.
        state.bias += if LOSSLESS { error } else { error * (2 * parameters.near + 1) };
        state.magnitude += error.unsigned_abs();
        if state.count == parameters.reset {
            state.magnitude >>= 1;
            state.bias >>= 1;
            state.count >>= 1;
        }
        state.count += 1;
        let count = state.count.cast_signed();
        if state.bias <= -count {
            state.correction = (state.correction - 1).max(-128);
            state.bias = (state.bias + count).max(1 - count);
        } else if state.bias > 0 {
            state.correction = (state.correction + 1).min(127);
            state.bias = (state.bias - count).min(0);
        }
        Ok(reconstruct::<LOSSLESS>(parameters, predicted, if negated { -error } else { error }))
    }

    /// The prediction error of the sample that ends a run (T.87 section A.7.2).
    fn run_end(&mut self, stream: &mut Stream<'_>, alike: bool, run_order: u8) -> Result<i32, CodecError> {
        let parameters = &self.parameters;
        let state = &mut self.run_contexts[usize::from(alike)];
        let kind = u32::from(alike);
        let k = golomb_order(state.count, state.magnitude + if alike { state.count >> 1 } else { 0 });
        // LIMIT is 2 (b + max(8, b)) for samples of b bits and error_bits <= b, so that at least 1 is left.
        let escape = parameters.limit - u32::from(run_order) - 1 - parameters.error_bits - 1;
        let code = stream.golomb(k, escape, parameters.error_bits)?;
        let code = checked(parameters, code)?.unsigned_abs();
        let folded = code + kind;
        let odd = folded & 1 == 1;
        let magnitude = folded.div_ceil(2);
        let negative = odd == (k != 0 || 2 * state.negative >= state.count);
        if negative && magnitude > 0 {
            state.negative += 1;
        }
        state.magnitude += (code + 1 - kind) >> 1;
        if state.count == parameters.reset {
            state.magnitude >>= 1;
            state.count >>= 1;
            state.negative >>= 1;
        }
        state.count += 1;
        let magnitude = magnitude.cast_signed();
        Ok(if negative { -magnitude } else { magnitude })
    }
}

/// The state of contexts before the first sample (T.87 section A.8).
fn initial(parameters: &Parameters) -> (Context, RunContext) {
    let magnitude = ((parameters.range + 32) / 64).max(2).unsigned_abs();
    (Context { magnitude, bias: 0, correction: 0, count: 1 }, RunContext { magnitude, count: 1, negative: 0 })
}

/// The class of a gradient, -4 to 4 (T.87 section A.3.3); the classes lie symmetrically about 0.
#[inline]
fn quantise(parameters: &Parameters, gradient: i32) -> i8 {
    let magnitude = gradient.abs();
    let [first, second, third] = parameters.thresholds;
    let class = i8::from(magnitude > parameters.near)
        + i8::from(magnitude >= first)
        + i8::from(magnitude >= second)
        + i8::from(magnitude >= third);
    if gradient < 0 { -class } else { class }
}

/// The context of a sample, -364 to 364, below 0 where its gradients are taken negated; 0 begins a run.
#[inline]
fn context(parameters: &Parameters, step_left: i8, step: i8, left: u16, corner: u16) -> i32 {
    let down = quantise(parameters, i32::from(corner) - i32::from(left));
    81 * i32::from(step) + 9 * i32::from(step_left) + i32::from(down)
}

/// The median of left, above, and their plane (T.87 section A.4.1).
#[inline]
fn predict(left: u16, up: u16, corner: u16) -> i32 {
    let (low, high) = (i32::from(left.min(up)), i32::from(left.max(up)));
    (low + high - i32::from(corner)).clamp(low, high)
}

/// The least k with `count << k >= magnitude` (T.87 section A.5.1); `count` is at least 1.
#[inline]
fn golomb_order(count: u32, magnitude: u32) -> u32 {
    if magnitude <= count {
        return 0;
    }
    let k = count.leading_zeros() - magnitude.leading_zeros();
    k + u32::from(u64::from(count) << k < u64::from(magnitude))
}

/// Checks that an encoder can have written a code value.
///
/// Errors are reduced to RANGE values before they are folded, so valid codes are below it; this bounds every sum of the
/// contexts.
#[inline]
fn checked(parameters: &Parameters, code: u64) -> Result<i32, CodecError> {
    match i32::try_from(code) {
        Ok(value) if value <= 1 << parameters.error_bits => Ok(value),
        _ => Err(damaged(format!("a prediction error of {code} is larger than any at this precision"))),
    }
}

/// The sample from its prediction and error (T.87 section A.4.5).
#[inline]
#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped to 0..=65535")]
fn reconstruct<const LOSSLESS: bool>(parameters: &Parameters, predicted: i32, error: i32) -> u16 {
    let Parameters { maximum, near, range, .. } = *parameters;
    let width = if LOSSLESS { 1 } else { 2 * near + 1 };
    let mut sample = predicted + error * width;
    if sample < -near {
        sample += range * width;
    } else if sample > maximum + near {
        sample -= range * width;
    }
    sample.clamp(0, maximum) as u16
}

/// The length of the run that begins here, at most the `rest` samples of the line (T.87 section A.7.1).
fn run_length(stream: &mut Stream<'_>, run_index: &mut usize, rest: usize) -> Result<usize, CodecError> {
    let mut run = 0;
    while stream.bit()? {
        let segment = 1_usize << RUN_ORDERS[*run_index];
        if segment <= rest - run {
            run += segment;
            *run_index = (*run_index + 1).min(RUN_ORDERS.len() - 1);
        } else {
            run = rest;
        }
        if run == rest {
            return Ok(run);
        }
    }
    let tail = stream.bits(u32::from(RUN_ORDERS[*run_index]))?;
    run = usize::try_from(tail).map_err(|_| ends_early())?.saturating_add(run);
    if run >= rest {
        return Err(damaged("a run goes past the end of its line"));
    }
    Ok(run)
}
