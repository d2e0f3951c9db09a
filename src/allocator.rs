//! The C library's allocator told to give memory back.
#![expect(unsafe_code, reason = "a setting of the C library")]

/// Buffers from this size on are mapped on their own, so that freeing them returns them at once.
const MAPPED_FROM: i32 = 128 << 10;

/// Fixes the size from which buffers are mapped, for programs that promise their resident memory.
///
/// Left alone, glibc raises that size whenever a larger buffer is freed, up to 32 MiB; from then on buffers
/// of that size come from heaps that keep what is freed, and a process that does one job after another
/// holds more than any of them needs. Called once, before other threads exist. Other C libraries, and other
/// systems, are left as they are.
pub fn give_memory_back() {
    #[cfg(all(target_os = "linux", target_env = "gnu"))]
    // SAFETY: mallopt takes two integers and changes settings of the allocator only; the man page allows it
    // at any time, and no other thread runs yet that could allocate meanwhile.
    unsafe {
        libc::mallopt(libc::M_MMAP_THRESHOLD, MAPPED_FROM);
        libc::mallopt(libc::M_TRIM_THRESHOLD, MAPPED_FROM);
        libc::mallopt(libc::M_ARENA_MAX, 2);
    }
}
