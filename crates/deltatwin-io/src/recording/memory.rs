//! Memory that recordings may need.

/// Memory of reading and analysing a recording, relative to its numbers: columns, signals, smoothed derivatives and what
/// is predicted for them.
const RELATIVE: u64 = 5;
/// Assumed where the system does not tell what is free, bytes.
const UNKNOWN: u64 = 4 << 30;

/// Memory that the messages or columns of a recording may need, bytes, if all may be `max` or else three quarters of
/// what is free.
pub(super) fn for_messages(max: Option<u64>) -> usize {
    let all = max.unwrap_or_else(|| free().unwrap_or(UNKNOWN) / 4 * 3);
    usize::try_from(all / RELATIVE).unwrap_or(usize::MAX)
}

/// Memory that the process may still get, bytes; `None` where the system does not tell.
fn free() -> Option<u64> {
    let after = |file: &str, name: &str| -> Option<u64> {
        let text = std::fs::read_to_string(file).ok()?;
        let line = text.lines().find_map(|line| line.strip_prefix(name))?;
        line.split_whitespace().next()?.parse().ok()
    };
    let available = after("/proc/meminfo", "MemAvailable:").map(|kib| kib << 10);
    let limit = after("/proc/self/limits", "Max address space");
    available.into_iter().chain(limit).min()
}
