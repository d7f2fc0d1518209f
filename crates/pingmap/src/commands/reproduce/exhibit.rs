//! What of the experiment is wanted.

use clap::ValueEnum;

/// A table or figure of the paper's experiment.
#[derive(Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum Exhibit {
    /// Everything, and a page that holds it
    All,
    /// Table: events of every agent
    Events,
    /// Tables: what one or two points of its region tell an agent about its own held-out events
    Local,
    /// Tables: what everybody's points tell the team
    Team,
    /// Table: bounds on the KL divergence, and whether they order the policies as NLL does
    Certificate,
    /// Tables: radius and number of points beyond the paper's
    Sweep,
    /// Figure: tracks, and the local events of one region
    Tracks,
    /// Figure: good, random and bad points of that region
    Points,
    /// Figure: what the team predicts right and wrong
    Predictions,
}

impl Exhibit {
    /// The names of its figures' files.
    pub fn pictures(self) -> &'static [&'static str] {
        match self {
            Exhibit::All => &["tracks", "points", "predictions"],
            Exhibit::Tracks => &["tracks"],
            Exhibit::Points => &["points"],
            Exhibit::Predictions => &["predictions"],
            _ => &[],
        }
    }

    /// Whether it is a figure, or holds some.
    pub fn has_pictures(self) -> bool {
        !self.pictures().is_empty()
    }
}
