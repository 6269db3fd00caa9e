//! Returns freed memory to the system.

/// Returns the memory that the process has freed.
///
/// glibc gives each thread one of several heaps and keeps what is freed in them. The threads of the next training may get
/// other heaps, so that a run of many trainings would grow by the examples of each (13 GB after sixteen trainings).
#[cfg(all(target_os = "linux", target_env = "gnu"))]
#[allow(unsafe_code, reason = "malloc_trim has no safe wrapper")]
pub(super) fn release() {
    // SAFETY: malloc_trim takes any padding and locks the heaps that it trims.
    unsafe { libc::malloc_trim(0) };
}

/// Other allocators return freed memory themselves.
#[cfg(not(all(target_os = "linux", target_env = "gnu")))]
pub(super) fn release() {}
