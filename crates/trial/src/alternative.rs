//! Alternative uses of the same bytes, with which pingmap's packets are compared.

use crate::paper::Policy;

/// An alternative use of the bytes of a frame. All alternatives quantise positions and values as our packets do.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Alternative {
    /// Only map messages: inducing points that summarise all events.
    SummariesOnly,
    /// Only reports: single outcomes by one bit each, and the sender's track.
    ReportsOnly,
    /// Our map messages without rounding: equal points with exact numbers.
    Unrounded,
    /// As many raw events as fit; events that reduce the trace most come first.
    RawEvents,
    /// Our packets at points drawn at random.
    RandomPoints,
    /// Our packets at the points that reduce the trace least.
    BadPoints,
    /// Variational summaries at good points. Each event belongs to the packet that explains most of its prior variance.
    Variational,
    /// The paper's scheme: variational summaries at points chosen by a policy, concatenated without the receiver's raw
    /// events.
    Concatenation(Policy),
}

impl Alternative {
    /// All alternatives.
    pub const ALL: [Alternative; 8] = [
        Alternative::SummariesOnly,
        Alternative::ReportsOnly,
        Alternative::Unrounded,
        Alternative::RawEvents,
        Alternative::RandomPoints,
        Alternative::BadPoints,
        Alternative::Variational,
        Alternative::Concatenation(Policy::Good),
    ];

    /// Returns the name of the alternative.
    pub fn name(self) -> &'static str {
        match self {
            Alternative::SummariesOnly => "summaries only",
            Alternative::ReportsOnly => "reports only",
            Alternative::Unrounded => "unrounded",
            Alternative::RawEvents => "raw events",
            Alternative::RandomPoints => "random points",
            Alternative::BadPoints => "bad points",
            Alternative::Variational => "variational",
            Alternative::Concatenation(Policy::Good) => "concatenation",
            Alternative::Concatenation(Policy::Random) => "concatenation, random",
            Alternative::Concatenation(Policy::Bad) => "concatenation, bad",
        }
    }

    /// Whether the alternative fits into the frames. Exact numbers do not fit.
    pub fn is_sendable(self) -> bool {
        self != Alternative::Unrounded
    }
}
