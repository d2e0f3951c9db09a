//! Unneeded resident memory, given back to the system.
//!
//! Two kinds of memory stay resident without need: buffers that the C library's allocator keeps after they are freed,
//! and pages of the program's own code that have run once. In a process of a few MiB both weigh.
#![expect(unsafe_code, reason = "a setting of the C library, and advice on mappings of files")]

use std::fs;

/// Buffers from this size on are mapped on their own, so that freeing them returns them at once
/// ([`map_large_buffers`]): glibc's own first threshold, kept from growing. Buffers below it come from heaps that
/// keep what is freed; stages whose memory the next one needs read through such small ones.
pub(crate) const MAPPED_FROM: usize = 128 << 10;

/// Difference of [`own_rss_bytes`](super::own_rss_bytes) between two runs of the same job: largest less smallest
/// `RssAnon` at the same place. Added to the stated smallest cap, so that it suffices.
pub(crate) const HELD_SPREAD: u64 = 192 << 10;

/// Bytes of a thread that the budget's own figures do not count: none.
pub(crate) const THREAD_BYTES: u64 = 0;

/// Fixes the size from which buffers are mapped, for programs that keep a cap of their resident memory.
///
/// By default, glibc raises that size whenever a larger buffer is freed, up to 32 MiB; from then on buffers of that
/// size come from heaps that keep what is freed, and a process that does one job after another holds more than any of
/// them needs. Called once, before other threads exist. Other C libraries are left as they are.
pub fn map_large_buffers() {
    #[cfg(target_env = "gnu")]
    #[expect(clippy::cast_possible_truncation, clippy::cast_possible_wrap, reason = "a small constant")]
    // SAFETY: mallopt takes two integers and changes settings of the allocator only; the man page allows it
    // at any time, and no other thread runs yet that could allocate meanwhile.
    unsafe {
        libc::mallopt(libc::M_MMAP_THRESHOLD, MAPPED_FROM as i32);
        libc::mallopt(libc::M_TRIM_THRESHOLD, MAPPED_FROM as i32);
        libc::mallopt(libc::M_ARENA_MAX, 2);
    }
}

/// Gives back the remains of the stage of a job that has just ended: freed memory that the allocator keeps, and code.
///
/// Cost: the kernel walks the pages of all mappings once (some 100 us), and some hundred page faults later.
pub fn give_back() {
    #[cfg(target_env = "gnu")]
    // SAFETY: malloc_trim takes an integer, may be called by any thread at any time, and gives back pages of
    // the allocator that hold nothing.
    unsafe {
        libc::malloc_trim(0);
    }
    give_code_back();
}

/// Gives back the pages of code and constants that are resident now; pages that are still needed come back from the
/// system's cache when they are touched.
///
/// The kernel maps sixteen pages around every one that runs, so that starting a program, reading its arguments and
/// opening its input leave three to four MiB of code behind that a long job never calls again. The amount differs from
/// run to run, by the program's place in memory. Only mappings of the program and its libraries that may not be written
/// and hold no changed page are given back, so that only time can be lost.
fn give_code_back() {
    let mut unchanged = unchanged_files(&fs::read_to_string("/proc/self/smaps").unwrap_or_default());
    // SAFETY: the callback takes the list that is passed with it, which outlives the call; nothing else
    // refers to the list meanwhile.
    unsafe {
        libc::dl_iterate_phdr(Some(let_code_go), (&raw mut unchanged).cast());
    }
}

/// Least piece of a mapping whose pages are mapped together, and most pieces.
const PIECE_BYTES: usize = 256 << 10;
const MAX_PIECES: usize = 1024;

/// Splits a mapping, so that sixteen pages are mapped at a time.
///
/// Linux 6.18 maps up to 2 MiB around a page that is touched, where its cache holds as much in one piece, but not
/// beyond the mapping's end. So every other piece is advised of the default behaviour.
pub(crate) fn part_mapping(map: &memmap2::Mmap) {
    let piece = PIECE_BYTES.max(map.len().div_ceil(MAX_PIECES).next_multiple_of(PIECE_BYTES));
    for at in (0..map.len()).step_by(2 * piece) {
        let _ = map.advise_range(memmap2::Advice::NoHugePage, at, piece.min(map.len() - at));
    }
}

/// Gives back the mappings of a list that are segments of one loaded object: the program, or a library.
///
/// # Safety
/// To be called by `dl_iterate_phdr` with a `Vec<Mapping>`.
unsafe extern "C" fn let_code_go(
    object: *mut libc::dl_phdr_info,
    _: libc::size_t,
    unchanged: *mut libc::c_void,
) -> libc::c_int {
    // SAFETY: the caller's promises: both are valid for this call, and the list is what was passed.
    let (object, unchanged) = unsafe { (&*object, &*unchanged.cast::<Vec<Mapping>>()) };
    if object.dlpi_phdr.is_null() {
        return 0;
    }
    // SAFETY: the loader says so of its own table, which lives as long as the object is loaded.
    let segments = unsafe { std::slice::from_raw_parts(object.dlpi_phdr, object.dlpi_phnum.into()) };
    for segment in segments.iter().filter(|s| s.p_type == libc::PT_LOAD && s.p_flags & libc::PF_W == 0) {
        let start = usize::try_from(object.dlpi_addr.wrapping_add(segment.p_vaddr));
        let (Ok(start), Ok(len)) = (start, usize::try_from(segment.p_memsz)) else { continue };
        for Mapping { start, len } in unchanged.iter().filter(|mapping| mapping.lies_in(start, len)) {
            // SAFETY: the range is a segment of an object that stays loaded during this call, as the loader
            // takes no object off its list meanwhile: no other thread can have unmapped it and mapped something
            // of its own there since the kernel was asked, as it could with any other file. It is a private
            // mapping of a file without write permission and without a page that differs from the file (the
            // kernel has just reported so), so that reading it again, by this thread or any other, finds the same
            // bytes. Code is not written while it runs.
            unsafe {
                libc::madvise(std::ptr::without_provenance_mut(*start), *len, libc::MADV_DONTNEED);
            }
        }
    }
    0
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Mapping {
    start: usize,
    len: usize,
}

impl Mapping {
    /// True if it lies in the pages of these bytes, of which the first and the last may be partial.
    fn lies_in(self, start: usize, len: usize) -> bool {
        // Size of the largest pages of any system.
        const PAGE: usize = 64 << 10;
        let end = start.saturating_add(len);
        let (own_end, last) = (self.start.saturating_add(self.len), end.saturating_add(PAGE));
        self.start < end && start < own_end && self.start.saturating_add(PAGE) > start && own_end < last
    }
}

/// The private mappings of files in `/proc/PID/smaps` that are not writable and equal their files.
fn unchanged_files(smaps: &str) -> Vec<Mapping> {
    let mut found = Vec::new();
    let mut candidate = None;
    for line in smaps.lines() {
        if let Some(mapping) = header(line) {
            candidate = mapping;
        } else if let Some(kib) = line.strip_prefix("Anonymous:")
            && let Some(mapping) = candidate.take()
            && kib.trim() == "0 kB"
        {
            found.push(mapping);
        }
    }
    found
}

/// Reads the first line of a mapping; `Some(None)` is one that has to stay.
fn header(line: &str) -> Option<Option<Mapping>> {
    let mut words = line.split_ascii_whitespace();
    let (start, end) = words.next()?.split_once('-')?;
    let [start, end] = [start, end].map(|hex| usize::from_str_radix(hex, 16).ok());
    let (start, end) = (start?, end?);
    let may = words.next()?.as_bytes();
    let inode = words.nth(2)?;
    let stays = may.contains(&b'w') || !may.contains(&b'p') || inode == "0";
    Some((!stays).then_some(Mapping { start, len: end.checked_sub(start)? }))
}

#[cfg(test)]
mod tests {
    use super::*;

    const SMAPS: &str = "\
5500aa000-5500ab000 r--p 00000000 08:01 12                       /a program
Size:                  4 kB
Anonymous:             0 kB
5500ab000-5500ae000 r-xp 00001000 08:01 12                       /a program
Anonymous:             0 kB
5500ae000-5500af000 r--p 00003000 08:01 12                       /a program
Anonymous:             4 kB
5500af000-5500b0000 rw-p 00004000 08:01 12                       /a program
Anonymous:             0 kB
7f00aa000-7f00bb000 rw-p 00000000 00:00 0
Anonymous:            68 kB
7f00bb000-7f00bc000 r--s 00000000 08:01 13                       /a model
Anonymous:             0 kB
7f00bc000-7f00bd000 r-xp 00000000 00:00 0                        [vdso]
Anonymous:             0 kB
";

    #[test]
    fn only_unchanged_pages_of_private_read_only_files_are_let_go() {
        let expected =
            [Mapping { start: 0x5_500a_a000, len: 4096 }, Mapping { start: 0x5_500a_b000, len: 3 * 4096 }];
        assert_eq!(unchanged_files(SMAPS), expected);
        assert_eq!(unchanged_files("no\nsuch-thing r--p\nAnonymous: 0 kB\n"), []);
    }

    #[test]
    fn only_segments_of_programs_are_let_go() {
        let mapping = Mapping { start: 0x5000, len: 0x3000 };
        assert!(mapping.lies_in(0x5000, 0x3000) && mapping.lies_in(0x5abc, 0x2001));
        for (start, len) in [(0x8000, 0x3000), (0x2000, 0x3000), (0x5000, 0), (usize::MAX, usize::MAX)] {
            assert!(!mapping.lies_in(start, len), "{start:x}");
        }
        assert!(!Mapping { start: 0x5000, len: 0x30_0000 }.lies_in(0x5000, 0x3000));
    }

    #[test]
    fn a_mapped_file_that_is_no_program_stays() {
        use std::io::Write as _;
        let mut file = tempfile::tempfile().unwrap();
        file.write_all(&vec![7; 1 << 20]).unwrap();
        // SAFETY: the file has no name, and no one else writes it.
        let map = unsafe { memmap2::MmapOptions::new().map_copy_read_only(&file).unwrap() };
        assert!(map.iter().all(|b| *b == 7));
        let before = crate::budget::mapped_rss_bytes(&map);
        give_code_back();
        assert_eq!(crate::budget::mapped_rss_bytes(&map), before);
        assert_eq!(before, Some(1 << 20));
    }

    #[test]
    fn code_goes_and_comes_back() {
        use crate::budget::file_rss_bytes;
        // Other tests run at the same time and touch their own code: one attempt of several has to succeed.
        let fell = (0..20).any(|_| {
            let before = file_rss_bytes();
            give_code_back();
            file_rss_bytes() < before
        });
        assert!(fell);
        assert_eq!(header("Rss: 4 kB"), None);
    }
}
