//! The machine that times and memory were measured on.

use std::time::{SystemTime, UNIX_EPOCH};

use serde::Serialize;

use crate::cpu::Form;
use crate::platform;

/// Facts of the machine and the program.
#[derive(Clone, Debug, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct Machine {
    /// Version of the program.
    pub version: String,
    /// Day and minute in UTC, such as 2026-01-31 12:00.
    #[serde(rename = "measured_utc")]
    pub measured: String,
    /// Name of the processor, as the system reports it.
    pub processor: String,
    /// Cores that the process may use.
    pub cores: usize,
    /// Instruction set of the traversal.
    pub traversal: &'static str,
    /// Memory of the machine in MiB.
    pub memory_mib: Option<u64>,
    /// Operating system.
    pub system: String,
}

impl Machine {
    /// This one, now.
    pub(crate) fn here() -> Self {
        Self {
            version: env!("CARGO_PKG_VERSION").into(),
            measured: utc(SystemTime::now().duration_since(UNIX_EPOCH).map_or(0, |d| d.as_secs())),
            processor: platform::processor().unwrap_or_else(|| "unknown".into()),
            cores: std::thread::available_parallelism().map_or(1, usize::from),
            traversal: Form::best().name(),
            memory_mib: platform::memory_mib(),
            system: format!("{} {}", std::env::consts::OS, platform::system_release().trim()),
        }
    }
}

/// Day and minute of a time since 1970 (Hinnant, *chrono-compatible low-level date algorithms*, `civil_from_days`).
fn utc(seconds: u64) -> String {
    let (days, rest) = (seconds / 86_400 + 719_468, seconds % 86_400);
    let (era, of_era) = (days / 146_097, days % 146_097);
    let year_of_era = (of_era - of_era / 1460 + of_era / 36_524 - of_era / 146_096) / 365;
    let of_year = of_era - (365 * year_of_era + year_of_era / 4 - year_of_era / 100);
    let shifted = (5 * of_year + 2) / 153;
    let day = of_year - (153 * shifted + 2) / 5 + 1;
    let month = if shifted < 10 { shifted + 3 } else { shifted - 9 };
    let year = year_of_era + era * 400 + u64::from(month <= 2);
    format!("{year}-{month:02}-{day:02} {:02}:{:02}", rest / 3600, rest / 60 % 60)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn days_are_those_of_the_calendar() {
        for (seconds, text) in [
            (0, "1970-01-01 00:00"),
            (951_782_400 + 3600, "2000-02-29 01:00"),
            (1_709_164_799, "2024-02-28 23:59"),
            (4_107_542_399, "2100-02-28 23:59"),
            (4_107_542_400, "2100-03-01 00:00"),
        ] {
            assert_eq!(utc(seconds), text);
        }
        let here = Machine::here();
        assert!(here.cores >= 1 && !here.system.is_empty());
    }
}
