//! Optional terms: those that learning may add to the basic terms of the latent function.

/// A term of the latent function that learning may add to the basic terms.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum OptionalTerm {
    /// Loss over the range as a smooth curve. The prior mean has only a line.
    Range,
    /// Difference of the path term between the two directions of a path. Their correlation, which is the reciprocity of
    /// the path term, is then learned.
    OneWay,
    /// Offset of every receiver, because sensitivities differ.
    Receivers,
    /// Offset of every transmitter, because source levels differ.
    Transmitters,
    /// Slow changes of the water with time, equal at all positions.
    Time,
    /// Offset of every message kind. For example, higher rates are harder to decode.
    Kinds,
    /// Noise at the position of the receiver.
    ReceiverPlace,
    /// Loss over the range as a rough curve with steps and peaks: Matérn 1/2 instead of the structure's shape.
    RoughRange,
    /// Direction of the receiver as seen from the transmitter. For example, a hull shadows its own transducer.
    TransmitterAspect,
    /// Direction of the transmitter as seen from the receiver.
    ReceiverAspect,
    /// Layers of the water: mean depth and difference of the depths of both ends, and range.
    Vertical,
    /// Second path term over raw positions, with separate length-scales east and north. It models walls and quays.
    Walls,
}

impl OptionalTerm {
    /// All optional terms, in the order in which learning tries them.
    pub const ALL: [OptionalTerm; 12] = [
        OptionalTerm::Range,
        OptionalTerm::ReceiverPlace,
        OptionalTerm::Vertical,
        OptionalTerm::TransmitterAspect,
        OptionalTerm::ReceiverAspect,
        OptionalTerm::OneWay,
        OptionalTerm::Kinds,
        OptionalTerm::Receivers,
        OptionalTerm::Transmitters,
        OptionalTerm::Time,
        OptionalTerm::RoughRange,
        OptionalTerm::Walls,
    ];

    /// Returns true if the term is common to links in all waters. Leave-one-out predictions alone then decide about it.
    pub const fn is_common(self) -> bool {
        matches!(self, OptionalTerm::Range | OptionalTerm::ReceiverPlace)
    }

    /// Returns the name of the term in files and on the command line.
    pub const fn name(self) -> &'static str {
        match self {
            OptionalTerm::Range => "range",
            OptionalTerm::Receivers => "receivers",
            OptionalTerm::Transmitters => "transmitters",
            OptionalTerm::Time => "time",
            OptionalTerm::Kinds => "kinds",
            OptionalTerm::ReceiverPlace => "receiver-place",
            OptionalTerm::RoughRange => "rough-range",
            OptionalTerm::TransmitterAspect => "transmitter-aspect",
            OptionalTerm::ReceiverAspect => "receiver-aspect",
            OptionalTerm::Vertical => "vertical",
            OptionalTerm::OneWay => "one-way",
            OptionalTerm::Walls => "walls",
        }
    }
}

/// A set of optional terms, stored as bits.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct OptionalTerms(u16);

impl OptionalTerms {
    /// Empty set.
    pub const NONE: OptionalTerms = OptionalTerms(0);

    /// Returns true if the set contains this term.
    pub fn has(self, addition: OptionalTerm) -> bool {
        self.0 & (1 << addition as u16) != 0
    }

    /// Returns the set with this term added.
    #[must_use]
    pub fn with(self, addition: OptionalTerm) -> Self {
        Self(self.0 | 1 << addition as u16)
    }

    /// Returns the terms of the set, in the order of [`OptionalTerm::ALL`].
    pub fn iter(self) -> impl Iterator<Item = OptionalTerm> {
        OptionalTerm::ALL.into_iter().filter(move |&addition| self.has(addition))
    }
}

impl FromIterator<OptionalTerm> for OptionalTerms {
    fn from_iter<I: IntoIterator<Item = OptionalTerm>>(additions: I) -> Self {
        additions.into_iter().fold(Self::NONE, Self::with)
    }
}
