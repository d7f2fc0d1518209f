//! Invariants of every run.

/// A broken invariant.
#[derive(Debug, Clone, PartialEq)]
#[allow(dead_code, reason = "the fields are printed")]
pub enum Finding {
    /// The store does not hold what was acknowledged.
    LostRecords { vehicle: usize, slot: u32, problem: String },
    /// Two events of one vehicle have one slot.
    CountedTwice { vehicle: usize, time_s: f64 },
    /// The restarted vehicle differs from one with the acknowledged records.
    OtherSnapshot { vehicle: usize, slot: u32 },
    /// A frame counts that no member sent.
    AcceptedForgery { vehicle: usize, slot: u32 },
    /// Two packets of one vehicle have one counter.
    ReusedCounter { vehicle: usize, counter: u16 },
    /// A vehicle stores more than its limits allow.
    OverLimit { vehicle: usize, events: usize },
    /// The clock of a vehicle is wrong at the end.
    WrongClock { vehicle: usize, clock_s: f64 },
    /// A vehicle refused a message of its host that was right.
    Refused { vehicle: usize, slot: u32, problem: String },
}

/// Slots of which the water let some through.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Slots {
    pub count: f64,
    pub heard: f64,
    /// Sum of the probabilities that the water lets these slots through, and the variance of the number heard.
    pub expected: f64,
    pub variance: f64,
}

impl Slots {
    fn add(&mut self, other: &Self) {
        self.count += other.count;
        self.heard += other.heard;
        self.expected += other.expected;
        self.variance += other.variance;
    }

    fn is_as_expected(&self) -> bool {
        (self.heard - self.expected).abs() <= 4.0 * self.variance.sqrt()
    }
}

/// The slots that counted, and those that did not.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Selection {
    pub counted: Slots,
    pub excluded: Slots,
}

impl Selection {
    /// Adds a slot: whether it counted, whether the water let it through, and the probability of that.
    pub fn add(&mut self, counts: bool, heard: bool, probability: f64) {
        let heard = f64::from(u8::from(heard));
        let slot = Slots { count: 1.0, heard, expected: probability, variance: probability * (1.0 - probability) };
        if counts { &mut self.counted } else { &mut self.excluded }.add(&slot);
    }

    pub fn plus(mut self, other: &Self) -> Self {
        self.counted.add(&other.counted);
        self.excluded.add(&other.excluded);
        self
    }

    /// Returns whether both kinds of slots were heard as often as the water let them through, within four standard
    /// deviations. Whether a slot counts then does not depend on its outcome.
    pub fn is_independent(&self) -> bool {
        self.counted.is_as_expected() && self.excluded.is_as_expected()
    }
}
