//! Bounds on the numbers in files and on the command line.
//!
//! Every number has a smallest and a largest value. A mistyped number therefore neither overflows when it is squared
//! nor requests more memory than is available.

use std::fmt;

/// A closed interval of valid numbers.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Bounds {
    /// Smallest valid number.
    pub min: f64,
    /// Largest valid number.
    pub max: f64,
    /// The interval in words. Error messages put it after "must be" or "expected".
    pub words: &'static str,
}

impl Bounds {
    const fn new(min: f64, max: f64, words: &'static str) -> Self {
        Self { min, max, words }
    }

    /// Returns `value` if it is within the bounds. Returns `None` for NaN.
    pub fn check(&self, value: f64) -> Option<f64> {
        (self.min <= value && value <= self.max).then_some(value)
    }

    /// Returns the whole number `value` if it is within the bounds.
    pub fn check_count(&self, value: usize) -> Option<usize> {
        self.check(value as f64).map(|_| value)
    }
}

impl fmt::Display for Bounds {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.write_str(self.words)
    }
}

/// Coordinates, in metres. The interval exceeds every distance on Earth, and its squares do not overflow.
pub const COORDINATE_M: Bounds = Bounds::new(-1e9, 1e9, "a finite number of metres, at most 1e9 from zero");

/// Numbers that may be zero but not negative.
pub const NOT_NEGATIVE: Bounds = Bounds::new(0.0, 1e9, "a number from 0 to 1e9");

/// Lengths that a user enters, in metres.
pub const LENGTH_M: Bounds = Bounds::new(1e-6, 1e9, "a number of metres from 1e-6 to 1e9");

/// Positive numbers that a user enters: lengths, variances, slopes.
pub const POSITIVE: Bounds = Bounds::new(1e-6, 1e9, "a number above 0, from 1e-6 to 1e9");

/// Variances and length-scales of a model. The interval is wider than [`POSITIVE`], because learning may exceed those
/// bounds.
pub const KERNEL_NUMBER: Bounds = Bounds::new(1e-15, 1e15, "a positive number from 1e-15 to 1e15");

/// Log-odds, or log-odds per metre.
pub const LOG_ODDS: Bounds = Bounds::new(-1e9, 1e9, "a number, at most 1e9 from zero");

/// Latitudes, in degrees, without the poles.
pub const LATITUDE_DEG: Bounds = Bounds::new(-89.999, 89.999, "a number from -89.999 to 89.999");

/// Longitudes, in degrees.
pub const LONGITUDE_DEG: Bounds = Bounds::new(-180.0, 180.0, "a number from -180 to 180");

/// Headings, in degrees clockwise from north.
pub const HEADING_DEG: Bounds = Bounds::new(-360.0, 360.0, "a number of degrees from -360 to 360");

/// Durations over which a track is extrapolated, in seconds.
pub const EXTRAPOLATION_S: Bounds = Bounds::new(0.0, 86_400.0, "a number of seconds from 0 to 86400");

/// Durations of a slot or of a time cell, in seconds.
pub const SLOT_S: Bounds = Bounds::new(1e-3, 1e6, "a number of seconds from 0.001 to 1e6");

/// Durations of a mission, in seconds. The mission has 63 time cells, and each is within [`SLOT_S`].
pub const MISSION_S: Bounds = Bounds::new(0.1, 6e7, "a number of seconds from 0.1 to 6e7");

/// Times, in seconds since the team's time origin.
pub const TIME_S: Bounds = Bounds::new(-1e12, 1e12, "a finite number of seconds, at most 1e12 from zero");

/// Minimum gains for which a packet is sent, in nats per event.
pub const MIN_GAIN_NATS: Bounds = Bounds::new(1e-300, 1e3, "a number above 0, at most 1000");

/// Thresholds of the surprise of a member, in standard deviations.
pub const EXCLUSION_THRESHOLD: Bounds = Bounds::new(1.0, 1e9, "a number from 1 to 1e9");

/// Numbers of events that a vehicle stores or a command uses.
pub const EVENTS: Bounds = Bounds::new(1.0, 1e7, "a whole number from 1 to 10000000");

/// Numbers of events of a dense fit. The fit takes 24 bytes for each pair of events.
pub const DENSE_EVENTS: Bounds = Bounds::new(1.0, 20_000.0, "a whole number from 1 to 20000");

/// Numbers of inducing points of a fit or of a selection. Learning selects them from four times as many candidates. The
/// selection takes two square matrices with one row per candidate.
pub const INDUCING_POINTS: Bounds = Bounds::new(1.0, 4000.0, "a whole number from 1 to 4000");

/// Numbers of events that are candidates for inducing points.
pub const CANDIDATES: Bounds = Bounds::new(1.0, 20_000.0, "a whole number from 1 to 20000");

/// Numbers of events that are absorbed one at a time after a fit.
pub const PENDING_EVENTS: Bounds = Bounds::new(1.0, 1000.0, "a whole number from 1 to 1000");

/// Numbers of past slots that a report may contain.
pub const REPORT_WINDOW: Bounds = Bounds::new(1.0, 262_144.0, "a whole number from 1 to 262144");

/// Numbers of inducing points of a site prior. Every posterior contains them.
pub const SITE_PRIOR_POINTS: Bounds = Bounds::new(1.0, 256.0, "a whole number from 1 to 256");

/// Entries of the whitened precision and shift of a site prior.
pub const INFORMATION: Bounds = Bounds::new(-1e9, 1e9, "a finite number, at most 1e9 from zero");

/// Numbers of packets of a vehicle. A counter has 16 bits.
pub const PACKETS: Bounds = Bounds::new(1.0, 65_536.0, "a whole number from 1 to 65536");

/// Numbers of packets or reports of each sender that count: the width of a window of counters. The largest one equals
/// [`crate::COUNTER_LEAD`], by which a counter may exceed those that the schedule allows.
pub const WINDOW: Bounds = Bounds::new(1.0, 1024.0, "a whole number from 1 to 1024");

/// Frame sizes, in bytes. No packet fits into fewer than 32 bytes.
pub const FRAME_BYTES: Bounds =
    Bounds::new(32.0, 65_536.0, "a whole number from 32 to 65536: no packet fits into less");

/// Numbers of unused bytes of a host message, which piggybacked outcomes may use.
pub const PIGGYBACK_BYTES: Bounds = Bounds::new(1.0, 8.0, "a whole number from 1 to 8");

/// Fractions, from 0 to 1.
pub const SHARE: Bounds = Bounds::new(0.0, 1.0, "a number from 0 to 1");

/// Sea states for which a wind speed is defined.
pub const SEA_STATE: Bounds = Bounds::new(0.0, 6.0, "a number from 0 to 6");

/// Intervals and delays of a vehicle, in seconds.
pub const INTERVAL_S: Bounds = Bounds::new(0.0, 1e6, "a number of seconds from 0 to 1e6");

/// Times after the end of a slot at which a vehicle counts it, in seconds.
pub const SETTLE_S: Bounds = Bounds::new(0.0, 600.0, "a number of seconds from 0 to 600");

/// Standard deviations of positions, in metres.
pub const SIGMA_M: Bounds = Bounds::new(1e-3, 1e6, "a number of metres from 0.001 to 1e6");

/// Messages in a queue.
pub const QUEUE: Bounds = Bounds::new(1.0, 1e6, "a whole number from 1 to 1000000");

/// Numbers of worker threads. Zero stands for one thread per core.
pub const THREADS: Bounds = Bounds::new(0.0, 256.0, "a whole number from 0 to 256");

/// Numbers of repetitions, such as splits or permutations.
pub const REPEATS: Bounds = Bounds::new(1.0, 10_000.0, "a whole number from 1 to 10000");
