//! The private header of Siemens MR images, "CSA": named tags with values as text.
//!
//! No standard describes it; the two forms are known from how they look. All numbers are 32-bit
//! little-endian, in files of either order.
//!
//! ```text
//! "SV10" and 4 bytes          newer form (CSA2) only
//! tags, 77                    how many there are
//! each tag:   name[64]  values  VR[4]  type  items  77 or 205
//! each item:  a  b  77 or 205  c, then its text, filled up to 4 bytes
//! ```
//!
//! The text of an item has `b` bytes in the newer form. In the older one (CSA1) it has `a` bytes, less the
//! number of items of the very first tag; where that is not a possible length, the tag ends with this item.
//! Readers disagree on whether a text that needs no filling up is followed by four bytes nevertheless: the 77 or 205 of
//! what comes next decides.
//!
//! Everything is read through the window: no declared length is allocated, and every step goes forwards, so that a
//! header of n bytes ends after n / 16 steps.

use std::borrow::Cow;
use std::fmt;
use std::io;
use std::str::FromStr;

use super::error::{ReadFault, ScanError};
use super::window::{ReadAt, Window};
use crate::fault::conversions;
use crate::text::shown;

/// Reason why the private header of a Siemens image cannot be read, as the end of a sentence.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct CsaFault(Cow<'static, str>);

impl CsaFault {
    fn new(text: impl Into<Cow<'static, str>>) -> Self {
        Self(text.into())
    }
}

impl fmt::Display for CsaFault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.0)
    }
}

conversions!(CsaFault {
    error: io::Error => Self::new(ReadFault::from(error).to_string()),
    error: ScanError => Self::new(error.to_string()),
});

/// Most tags, and most items of a tag; real headers have about a hundred tags of a few dozen items.
const MAX_COUNT: u32 = 1000;

/// Longest header that is read; real ones have some 12 KiB.
const MAX_BYTES: u64 = 1 << 20;

/// Bytes of the text of an item that are looked at; numbers are shorter.
const TEXT_BYTES: u64 = 64;

/// Offset of the 77 or 205 in the head of an item, and in the head of a tag.
const ITEM_MARK: u64 = 8;
const TAG_MARK: u64 = 80;

/// The fields of one image's header that matter here.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Csa {
    /// `NumberOfImagesInMosaic`.
    pub(crate) images: Option<u32>,
    /// `SliceNormalVector`: the direction of the next slice, a unit vector in LPS.
    pub(crate) normal: Option<[f64; 3]>,
}

/// Reads a header of `bytes` bytes at `start`, as far as both values.
///
/// # Errors
/// The header cannot be followed to its end, or the file cannot be read.
pub(crate) fn read<R: ReadAt + ?Sized>(
    window: &mut Window<'_, R>,
    start: u64,
    bytes: u64,
) -> Result<Csa, CsaFault> {
    let end = start.saturating_add(bytes.min(MAX_BYTES)).min(window.len());
    let mut reader = Reader { window, at: start, end };
    let newer = reader.array::<4>()? == *b"SV10";
    if newer {
        reader.skip(4)?;
    } else {
        reader.at = start;
    }
    let tags = reader.count("tags")?;
    reader.skip(4)?;
    let mut found = Csa::default();
    let mut less = None;
    for _ in 0..tags {
        let name = reader.array::<64>()?;
        reader.skip(12)?;
        let items = reader.count("items")?;
        reader.skip(4)?;
        let less = *less.get_or_insert(items);
        let length = |item: &[u32; 4]| if newer { Some(item[1]) } else { item[0].checked_sub(less) };
        match until_zero(&name) {
            b"NumberOfImagesInMosaic" => {
                found.images = reader.values::<u32, 1>(items, newer, &length)?.map(|[n]| n)
            }
            b"SliceNormalVector" => found.normal = reader.values::<f64, 3>(items, newer, &length)?,
            _ => {
                reader.values::<u32, 0>(items, newer, &length)?;
            }
        }
        if found.images.is_some() && found.normal.is_some() {
            break;
        }
    }
    Ok(found)
}

struct Reader<'w, 'a, R: ReadAt + ?Sized> {
    window: &'w mut Window<'a, R>,
    at: u64,
    end: u64,
}

impl<R: ReadAt + ?Sized> Reader<'_, '_, R> {
    fn skip(&mut self, bytes: u64) -> Result<(), CsaFault> {
        let after = self.at.saturating_add(bytes);
        if after > self.end {
            return Err(CsaFault::new(format!("it ends {} bytes too early", after - self.end)));
        }
        self.at = after;
        Ok(())
    }

    fn array<const N: usize>(&mut self) -> Result<[u8; N], CsaFault> {
        let at = self.at;
        self.skip(N as u64)?;
        self.window.array(at)?.ok_or_else(|| CsaFault::new("it ends too early"))
    }

    fn number(&mut self) -> Result<u32, CsaFault> {
        self.array().map(u32::from_le_bytes)
    }

    /// A count, at most [`MAX_COUNT`].
    fn count(&mut self, of: &str) -> Result<u32, CsaFault> {
        let stated = self.number()?;
        if stated > MAX_COUNT { Err(CsaFault::new(format!("it states {stated} {of}"))) } else { Ok(stated) }
    }

    /// True if 77 or 205, a number of unknown meaning, stands `ahead` bytes further.
    fn is_mark(&mut self, ahead: u64) -> Result<bool, CsaFault> {
        let found = self.window.array::<4>(self.at + ahead)?;
        Ok(found.is_some_and(|bytes| matches!(u32::from_le_bytes(bytes), 77 | 205)))
    }

    /// Steps over the items of a tag, and returns the first `N` of them as numbers, if they exist. A text that is not a
    /// number is a fault.
    fn values<T: FromStr + Copy + Default, const N: usize>(
        &mut self,
        items: u32,
        newer: bool,
        length: &dyn Fn(&[u32; 4]) -> Option<u32>,
    ) -> Result<Option<[T; N]>, CsaFault> {
        let mut values = [T::default(); N];
        let mut stated = 0;
        for k in 0..items as usize {
            let item = [self.number()?, self.number()?, self.number()?, self.number()?];
            let fits = |n: &u64| *n <= self.end - self.at;
            let Some(bytes) = length(&item).map(u64::from).filter(fits) else {
                if newer {
                    return Err(CsaFault::new("an item is longer than the rest of it"));
                }
                break;
            };
            if let Some(slot) = values.get_mut(k) {
                let most = usize::try_from(bytes.min(TEXT_BYTES)).unwrap_or(0);
                let text = self.window.upto(self.at, most)?;
                let text = String::from_utf8_lossy(until_zero(text));
                let text = text.trim();
                if !text.is_empty() {
                    let wrong = |_| CsaFault::new(format!("it states `{}` as a number", shown(text)));
                    *slot = text.parse().map_err(wrong)?;
                    stated += 1;
                }
            }
            // The last item of all may lack its padding.
            self.at = self.at.saturating_add(bytes.next_multiple_of(4)).min(self.end);
            let mark = if k + 1 < items as usize { ITEM_MARK } else { TAG_MARK };
            if !newer && bytes.is_multiple_of(4) && !self.is_mark(mark)? && self.is_mark(mark + 4)? {
                self.at += 4;
            }
        }
        Ok((stated == N).then_some(values))
    }
}

/// Text up to the first zero; bytes after it are left over from earlier texts.
fn until_zero(bytes: &[u8]) -> &[u8] {
    bytes.split(|b| *b == 0).next().unwrap_or(bytes)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::Random;

    /// One tag: its name and the texts of its items.
    type Tag<'a> = (&'a str, &'a [&'a str]);

    fn put(out: &mut Vec<u8>, numbers: &[u32]) {
        out.extend(numbers.iter().flat_map(|n| n.to_le_bytes()));
    }

    /// A header in the newer or the older form.
    fn write(newer: bool, tags: &[Tag<'_>]) -> Vec<u8> {
        written(newer, false, tags)
    }

    /// Like [`write`]; texts that need no filling up may be followed by four bytes nevertheless.
    fn written(newer: bool, full: bool, tags: &[Tag<'_>]) -> Vec<u8> {
        let mut out = Vec::new();
        if newer {
            out.extend(b"SV10\x04\x03\x02\x01");
        }
        let length = |n: usize| u32::try_from(n).unwrap();
        put(&mut out, &[length(tags.len()), 77]);
        let less = tags.first().map_or(0, |(_, items)| length(items.len()));
        for (name, items) in tags {
            let mut field = [0; 64];
            field[..name.len()].copy_from_slice(name.as_bytes());
            // Rubbish behind the name, as real headers have it.
            field[name.len() + 1..].fill(0xcd);
            out.extend(field);
            put(&mut out, &[length(items.len())]);
            out.extend(b"FD\0\0");
            put(&mut out, &[4, length(items.len()), 77]);
            for text in *items {
                let bytes = length(text.len());
                put(
                    &mut out,
                    &if newer { [bytes, bytes, 77, bytes] } else { [bytes + less, bytes + less, 77, bytes] },
                );
                out.extend(text.as_bytes());
                let fill =
                    if full { 4 - text.len() % 4 } else { text.len().next_multiple_of(4) - text.len() };
                out.resize(out.len() + fill, 0);
            }
        }
        out
    }

    const TAGS: [Tag<'static>; 5] = [
        ("EchoLinePosition", &["64      ", "", "", "", "", ""]),
        ("B_value", &[]),
        ("NumberOfImagesInMosaic", &["48      ", "", ""]),
        ("AcquisitionMatrixText", &["128p*128"]),
        ("SliceNormalVector", &["0.00000000", "0.00523632", "-0.99998629", ""]),
    ];

    fn parse(bytes: &[u8]) -> Result<Csa, CsaFault> {
        let mut file = vec![0xee; 13];
        file.extend(bytes);
        file.extend([0xee; 29]);
        let mut window = Window::new(&file[..]).unwrap();
        read(&mut window, 13, bytes.len() as u64)
    }

    #[test]
    fn both_forms_say_how_many_slices_there_are_and_where_they_go() {
        for newer in [true, false] {
            let read = parse(&write(newer, &TAGS)).unwrap();
            assert_eq!(read, Csa { images: Some(48), normal: Some([0.0, 0.005_236_32, -0.999_986_29]) });
            let none = parse(&write(newer, &TAGS[..2])).unwrap();
            assert_eq!(none, Csa::default());
        }
    }

    #[test]
    fn older_texts_may_be_followed_by_four_bytes_more() {
        let full = parse(&written(false, true, &TAGS)).unwrap();
        assert_eq!(full, parse(&write(false, &TAGS)).unwrap());
        assert!(written(false, true, &TAGS).len() > write(false, &TAGS).len() + 40);
    }

    #[test]
    fn what_is_no_number_is_named_and_no_text_is_missing() {
        for newer in [true, false] {
            for bad in [("NumberOfImagesInMosaic", &["4,8"][..]), ("SliceNormalVector", &["0", "4,8", "1"])] {
                let fault = parse(&write(newer, &[bad])).unwrap_err();
                assert_eq!(fault, CsaFault::new("it states `4,8` as a number"));
            }
            let none: [Tag<'_>; 2] =
                [("NumberOfImagesInMosaic", &["", "48"]), ("SliceNormalVector", &["0", "", "1"])];
            assert_eq!(parse(&write(newer, &none)).unwrap(), Csa::default());
            let short: [Tag<'_>; 1] = [("SliceNormalVector", &["0", "1"])];
            assert_eq!(parse(&write(newer, &short)).unwrap().normal, None);
        }
    }

    #[test]
    fn an_older_tag_ends_where_an_item_has_no_possible_length() {
        let mut bytes = write(false, &[("NumberOfImagesInMosaic", &["9"]), ("Other", &[]), TAGS[4]]);
        // `Other` claims five items; the first is shorter than nothing, and the next tag follows it.
        let other = 8 + 84 + 20;
        bytes[other + 76..other + 80].copy_from_slice(&5_u32.to_le_bytes());
        bytes.splice(other + 84..other + 84, [0; 16]);
        let read = parse(&bytes).unwrap();
        assert_eq!((read.images, read.normal.is_some()), (Some(9), true));
    }

    #[test]
    fn damage_is_told_in_words() {
        let sound = write(true, &TAGS);
        let mut many = sound.clone();
        many[8..12].copy_from_slice(&u32::MAX.to_le_bytes());
        assert_eq!(parse(&many).unwrap_err(), CsaFault::new(format!("it states {} tags", u32::MAX)));
        let mut items = sound.clone();
        items[16 + 76..16 + 80].copy_from_slice(&1001_u32.to_le_bytes());
        assert_eq!(parse(&items).unwrap_err(), CsaFault::new("it states 1001 items"));
        let mut long = sound.clone();
        long[100 + 4..100 + 8].copy_from_slice(&0x7fff_ffff_u32.to_le_bytes());
        assert_eq!(parse(&long).unwrap_err(), CsaFault::new("an item is longer than the rest of it"));
        assert_eq!(parse(&sound[..200]).unwrap_err(), CsaFault::new("it ends 4 bytes too early"));
        assert!(parse(&[]).is_err());
    }

    #[test]
    fn no_bytes_make_it_panic_or_go_on_for_long() {
        let mut random = Random(0x5eed);
        let (mut sound, mut refused, mut cut) = (0, 0, 0);
        for newer in [true, false] {
            let whole = write(newer, &TAGS);
            for length in 0..whole.len() {
                // A header that is cut says less, but nothing else.
                let read = parse(&whole[..length]).unwrap_or_default();
                assert!(read.images.is_none_or(|n| n == 48), "{length}: {read:?}");
                assert!(read.normal.is_none_or(|n| n[2] == -0.999_986_29), "{length}: {read:?}");
                cut += u32::from(read.normal.is_none());
            }
            for _ in 0..5000 {
                let mut bytes = whole.clone();
                for _ in 0..=random.below(4) {
                    let at = random.below(bytes.len());
                    bytes[at] = random.pick(&[0, 1, 0x7f, 0x80, 0xff]);
                }
                match parse(&bytes) {
                    Ok(_) => sound += 1,
                    Err(_) => refused += 1,
                }
            }
        }
        assert!(sound > 100 && refused > 100, "{sound} sound, {refused} refused");
        assert!(cut > 1000, "{cut} without a normal");
        // No more than the first MiB is looked at: after 65 tags and 188 items it has 8 bytes left.
        let items: Vec<&str> = vec![""; 1000];
        let tags: Vec<Tag<'_>> = vec![("X", &items); 100];
        assert_eq!(parse(&write(true, &tags)).unwrap_err(), CsaFault::new("it ends 4 bytes too early"));
    }
}
