//! Parts of the experiment that can be requested.

use clap::ValueEnum;

/// A table or figure of the paper's experiment.
#[derive(Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum Exhibit {
    /// Everything, and a page with all of it
    All,
    /// Table: events of every agent
    Events,
    /// Tables: predictions of an agent's held-out events from one or two points of its region
    Local,
    /// Tables: predictions of the team from the points of all agents
    Team,
    /// Table: bounds on the KL divergence, and whether they order the policies as NLL does
    Certificate,
    /// Tables: larger radii and more points than in the paper
    Sweep,
    /// Figure: tracks, and the local events of one region
    Tracks,
    /// Figure: good, random and bad points of that region
    Points,
    /// Figure: right and wrong predictions of the team
    Predictions,
}

impl Exhibit {
    /// Returns the file names of the exhibit's figures.
    pub fn pictures(self) -> &'static [&'static str] {
        match self {
            Exhibit::All => &["tracks", "points", "predictions"],
            Exhibit::Tracks => &["tracks"],
            Exhibit::Points => &["points"],
            Exhibit::Predictions => &["predictions"],
            _ => &[],
        }
    }

    /// Whether the exhibit contains figures.
    pub fn has_pictures(self) -> bool {
        !self.pictures().is_empty()
    }
}
