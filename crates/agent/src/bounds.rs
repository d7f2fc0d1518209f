//! Bounds on what people write, in files and on the command line: every number has a largest value beside its smallest
//! one, so that no slip of the pen overflows when it is squared, and none asks for more memory than there is.

use std::fmt;

/// From where to where a number may be, both ends included.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Bounds {
    /// The smallest.
    pub min: f64,
    /// The largest.
    pub max: f64,
    /// The same in words, after "must be" or "expected".
    pub words: &'static str,
}

impl Bounds {
    const fn new(min: f64, max: f64, words: &'static str) -> Self {
        Self { min, max, words }
    }

    /// The number, if it is within.
    pub fn check(&self, value: f64) -> Option<f64> {
        (self.min <= value && value <= self.max).then_some(value)
    }

    /// The whole number, if it is within.
    pub fn check_count(&self, value: usize) -> Option<usize> {
        self.check(value as f64).map(|_| value)
    }
}

impl fmt::Display for Bounds {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.write_str(self.words)
    }
}

/// Coordinates: farther than anything on Earth, and near enough that no square overflows.
pub const COORDINATE_M: Bounds = Bounds::new(-1e9, 1e9, "a finite number of metres, at most 1e9 from zero");

/// What may be nothing, and no less.
pub const NOT_NEGATIVE: Bounds = Bounds::new(0.0, 1e9, "a number from 0 to 1e9");

/// Lengths that people give.
pub const LENGTH_M: Bounds = Bounds::new(1e-6, 1e9, "a number of metres from 1e-6 to 1e9");

/// Positive numbers that people give: lengths, variances, slopes.
pub const POSITIVE: Bounds = Bounds::new(1e-6, 1e9, "a number above 0, from 1e-6 to 1e9");

/// Variances and length-scales of a model: wider than what people give, because learning may go farther.
pub const KERNEL_NUMBER: Bounds = Bounds::new(1e-15, 1e15, "a positive number from 1e-15 to 1e15");

/// Log-odds, and log-odds per metre.
pub const LOG_ODDS: Bounds = Bounds::new(-1e9, 1e9, "a number, at most 1e9 from zero");

/// Degrees of latitude, short of the poles.
pub const LATITUDE_DEG: Bounds = Bounds::new(-89.999, 89.999, "a number from -89.999 to 89.999");

/// Degrees of longitude.
pub const LONGITUDE_DEG: Bounds = Bounds::new(-180.0, 180.0, "a number from -180 to 180");

/// Seconds for which something is taken to go on as it did.
pub const ONWARD_S: Bounds = Bounds::new(0.0, 86_400.0, "a number of seconds from 0 to 86400");

/// Seconds of a slot.
pub const SLOT_S: Bounds = Bounds::new(1e-3, 1e6, "a number of seconds from 0.001 to 1e6");

/// Seconds of a mission, in 63 cells no shorter or longer than a slot may be.
pub const MISSION_S: Bounds = Bounds::new(0.1, 6e7, "a number of seconds from 0.1 to 6e7");

/// Times, in seconds from wherever a team counts.
pub const TIME_S: Bounds = Bounds::new(-1e12, 1e12, "a finite number of seconds, at most 1e12 from zero");

/// Nats that make a packet worth a frame.
pub const WORTH_NATS: Bounds = Bounds::new(1e-300, 1e3, "a number above 0, at most 1000");

/// Standard deviations by which a member may surprise.
pub const SURPRISE: Bounds = Bounds::new(1.0, 1e9, "a number from 1 to 1e9");

/// Events that a vehicle keeps or a command uses.
pub const EVENTS: Bounds = Bounds::new(1.0, 1e7, "a whole number from 1 to 10000000");

/// Events of a dense fit, which takes 24 bytes for each pair of them.
pub const DENSE_EVENTS: Bounds = Bounds::new(1.0, 20_000.0, "a whole number from 1 to 20000");

/// Inducing points, of a fit or to be chosen. Learning chooses them from four times as many candidates, which takes two
/// matrices of as many rows and columns.
pub const INDUCING_POINTS: Bounds = Bounds::new(1.0, 4000.0, "a whole number from 1 to 4000");

/// Events that are candidates for inducing points.
pub const CANDIDATES: Bounds = Bounds::new(1.0, 20_000.0, "a whole number from 1 to 20000");

/// Events beside a fit, each of which is taken in by itself.
pub const EVENTS_BESIDE: Bounds = Bounds::new(1.0, 1000.0, "a whole number from 1 to 1000");

/// Slots that a report looks back on.
pub const SLOTS_BACK: Bounds = Bounds::new(1.0, 262_144.0, "a whole number from 1 to 262144");

/// Points at which a place is known: every posterior holds them.
pub const PLACE_POINTS: Bounds = Bounds::new(1.0, 256.0, "a whole number from 1 to 256");

/// What is said of a place, whitened.
pub const INFORMATION: Bounds = Bounds::new(-1e9, 1e9, "a finite number, at most 1e9 from zero");

/// Packets of a vehicle: a counter has 16 bits.
pub const PACKETS: Bounds = Bounds::new(1.0, 65_536.0, "a whole number from 1 to 65536");

/// Packets of each sender that count: a window of counters, no wider than the farthest leap of a counter that is believed
/// at once.
pub const WINDOW: Bounds = Bounds::new(1.0, 1024.0, "a whole number from 1 to 1024");

/// Bytes of a frame: no packet fits into less than 32.
pub const FRAME_BYTES: Bounds =
    Bounds::new(32.0, 65_536.0, "a whole number from 32 to 65536: no packet fits into less");

/// Bytes that a message of a host's has left over.
pub const SPARE_BYTES: Bounds = Bounds::new(1.0, 8.0, "a whole number from 1 to 8");

/// Shares of a whole.
pub const SHARE: Bounds = Bounds::new(0.0, 1.0, "a number from 0 to 1");

/// Sea states that have a wind.
pub const SEA_STATE: Bounds = Bounds::new(0.0, 6.0, "a number from 0 to 6");

/// Worker threads; 0 takes one per core.
pub const THREADS: Bounds = Bounds::new(0.0, 256.0, "a whole number from 0 to 256");

/// How often something is repeated: splits, permutations.
pub const REPEATS: Bounds = Bounds::new(1.0, 10_000.0, "a whole number from 1 to 10000");
