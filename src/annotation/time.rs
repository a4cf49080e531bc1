//! Moments: milliseconds since 1970 in UTC, written as RFC 3339.

use std::sync::atomic::{AtomicI64, Ordering};
use std::time::{Duration, SystemTime, UNIX_EPOCH};

use chrono::{DateTime, SecondsFormat, Utc};
use serde::{Deserialize, Deserializer, Serialize, Serializer};

/// The step back of each reading of the clock, for tests, and the number of readings since.
static TURNED_BACK_MS: AtomicI64 = AtomicI64::new(0);
static READINGS: AtomicI64 = AtomicI64::new(1);

/// A moment in UTC, to the millisecond. As text `2026-01-31T12:00:00.000Z`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Timestamp(DateTime<Utc>);

impl Timestamp {
    /// Now, by this machine's clock.
    #[must_use]
    pub fn now() -> Self {
        let since = SystemTime::now().duration_since(UNIX_EPOCH).map_or(0, |since| since.as_millis());
        let step = TURNED_BACK_MS.load(Ordering::Relaxed);
        let turned_back =
            if step == 0 { 0 } else { step.saturating_mul(READINGS.fetch_add(1, Ordering::Relaxed)) };
        let now = i64::try_from(since).ok().and_then(|now| now.checked_sub(turned_back));
        now.and_then(Self::from_millis).unwrap_or(Self(DateTime::UNIX_EPOCH))
    }

    /// From here on, each reading of the clock is earlier than the one before by `step`: an injected
    /// failure, for the whole process.
    pub fn turn_clock_back(step: Duration) {
        TURNED_BACK_MS.store(i64::try_from(step.as_millis()).unwrap_or(i64::MAX), Ordering::Relaxed);
    }

    /// The time `ms` milliseconds after 1970; `None` beyond the range of the calendar.
    #[must_use]
    pub fn from_millis(millis: i64) -> Option<Self> {
        DateTime::from_timestamp_millis(millis).map(Self)
    }

    /// Milliseconds since 1970 began.
    #[must_use]
    pub fn millis(self) -> i64 {
        self.0.timestamp_millis()
    }
}

impl std::fmt::Display for Timestamp {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(&self.0.to_rfc3339_opts(SecondsFormat::Millis, true))
    }
}

impl std::str::FromStr for Timestamp {
    type Err = chrono::ParseError;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        let moment = DateTime::parse_from_rfc3339(text)?.with_timezone(&Utc);
        Ok(Self::from_millis(moment.timestamp_millis()).unwrap_or(Self(moment)))
    }
}

impl Serialize for Timestamp {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_str(self)
    }
}

impl<'de> Deserialize<'de> for Timestamp {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        String::deserialize(deserializer)?.parse().map_err(serde::de::Error::custom)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn moments_are_written_in_utc_and_read_with_any_offset() {
        let moment: Timestamp = "2026-01-31T13:30:00.1234+01:30".parse().unwrap();
        assert_eq!(moment.to_string(), "2026-01-31T12:00:00.123Z");
        assert_eq!(Timestamp::from_millis(moment.millis()), Some(moment));
        assert_eq!("2026-01-31T12:00:00.123Z".parse(), Ok(moment));
        assert!("yesterday".parse::<Timestamp>().is_err());
    }
}
