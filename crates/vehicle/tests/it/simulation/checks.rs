//! Invariants of every run.

/// A broken invariant.
#[derive(Debug, Clone, PartialEq)]
#[allow(dead_code, reason = "the fields are printed")]
pub enum Finding {
    /// The store does not hold what was acknowledged.
    LostRecords { vehicle: usize, slot: u32, problem: String },
    /// Two events of one vehicle have one slot.
    CountedTwice { vehicle: usize, time_s: f64 },
    /// The restarted vehicle differs from one with what was acknowledged.
    OtherSnapshot { vehicle: usize, slot: u32 },
    /// A frame counts that no member sent.
    AcceptedForgery { vehicle: usize, slot: u32 },
    /// Two packets of one vehicle have one counter.
    ReusedCounter { vehicle: usize, counter: u16 },
    /// A vehicle stores more than its limits allow.
    OverLimit { vehicle: usize, events: usize },
    /// A vehicle refused a message of its host that was right.
    Refused { vehicle: usize, slot: u32, problem: String },
}

/// How many slots counted, and how many of these the water let through; and the same for slots that did not count.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Selection {
    pub counted: f64,
    pub counted_heard: f64,
    pub excluded: f64,
    pub excluded_heard: f64,
    /// Sums of the probabilities that the water lets these slots through.
    pub counted_expected: f64,
    pub excluded_expected: f64,
    pub counted_variance: f64,
    pub excluded_variance: f64,
}

impl Selection {
    /// Adds a slot: whether it counted, whether the water let it through, and the probability of that.
    pub fn add(&mut self, counts: bool, heard: bool, probability: f64) {
        let heard = f64::from(u8::from(heard));
        let variance = probability * (1.0 - probability);
        let fields = if counts {
            (&mut self.counted, &mut self.counted_heard, &mut self.counted_expected, &mut self.counted_variance)
        } else {
            (&mut self.excluded, &mut self.excluded_heard, &mut self.excluded_expected, &mut self.excluded_variance)
        };
        *fields.0 += 1.0;
        *fields.1 += heard;
        *fields.2 += probability;
        *fields.3 += variance;
    }

    pub fn plus(&self, other: &Self) -> Self {
        Self {
            counted: self.counted + other.counted,
            counted_heard: self.counted_heard + other.counted_heard,
            excluded: self.excluded + other.excluded,
            excluded_heard: self.excluded_heard + other.excluded_heard,
            counted_expected: self.counted_expected + other.counted_expected,
            excluded_expected: self.excluded_expected + other.excluded_expected,
            counted_variance: self.counted_variance + other.counted_variance,
            excluded_variance: self.excluded_variance + other.excluded_variance,
        }
    }

    /// Returns whether both kinds of slots were heard as often as the water let them through, within four standard
    /// deviations. Whether a slot counts then does not depend on its outcome.
    pub fn is_independent(&self) -> bool {
        let is_near = |heard: f64, expected: f64, variance: f64| (heard - expected).abs() <= 4.0 * variance.sqrt();
        is_near(self.counted_heard, self.counted_expected, self.counted_variance)
            && is_near(self.excluded_heard, self.excluded_expected, self.excluded_variance)
    }
}
