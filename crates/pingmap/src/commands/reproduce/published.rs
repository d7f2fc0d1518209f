//! The figures of the paper's tables, for comparison: "Decentralized Gaussian Process Classification and an Application
//! in Subsea Robotics", Gao, He, Stilwell and McMahon, section IV. The paper gives no standard errors.

use pingmap_trial::paper::statistics::Metric;
use pingmap_trial::paper::{Choice, Policy};

/// Learned length-scale, in standardised units.
pub const LENGTH_SCALE: f64 = 0.289;

/// Number of the paper's table of events.
pub const EVENTS_TABLE: &str = "I";

/// Numbers of the paper's tables of [`LOCAL`].
const LOCAL_TABLES: [&str; 2] = ["II", "III"];

/// Numbers of the paper's tables of [`TEAM`].
const TEAM_TABLES: [&str; 3] = ["IV", "V", "VI"];

/// Failures and successes of every agent of the three data sets.
const EVENTS: [&[(usize, usize)]; 3] =
    [&[(248, 198), (219, 227)], &[(366, 197), (336, 227)], &[(132, 119), (105, 130), (103, 109)]];

/// Accuracy and NLL of one and of two points, for good, random and bad points.
type PaperTable = [[(f64, f64); 2]; 3];

/// Agents 1 and 2 of data set 1. The paper has no tables of the other data sets.
const LOCAL: [PaperTable; 2] = [
    [[(0.6498, 0.6685), (0.6552, 0.6280)], [(0.6458, 0.6546), (0.6489, 0.6444)], [(0.6427, 0.6558), (0.6455, 0.6499)]],
    [[(0.7152, 0.5902), (0.7272, 0.5588)], [(0.5747, 0.6706), (0.6249, 0.6353)], [(0.4838, 0.7004), (0.4835, 0.7029)]],
];

/// Teams of the three data sets.
const TEAM: [PaperTable; 3] = [
    [[(0.6844, 0.6315), (0.6941, 0.5815)], [(0.5972, 0.6674), (0.6504, 0.6296)], [(0.5606, 0.6765), (0.5620, 0.6765)]],
    [[(0.7442, 0.5020), (0.7442, 0.4918)], [(0.7485, 0.5756), (0.7493, 0.5327)], [(0.7433, 0.6320), (0.7437, 0.6111)]],
    [[(0.7101, 0.6267), (0.7270, 0.5976)], [(0.6979, 0.6433), (0.6967, 0.6273)], [(0.6947, 0.6550), (0.6981, 0.6532)]],
];

/// A score in the paper.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PublishedScore {
    /// Share of events whose more probable outcome occurred.
    pub accuracy: f64,
    /// Mean negative log-likelihood, in nats.
    pub nll: f64,
}

impl PublishedScore {
    /// Returns the score such that lower is better.
    pub fn cost(self, metric: Metric) -> f64 {
        match metric {
            Metric::Nll => self.nll,
            Metric::Accuracy => -self.accuracy,
        }
    }
}

/// One of the paper's data sets.
#[derive(Clone, Copy)]
pub struct Published(usize);

impl Published {
    /// Returns the paper's data set at a place, counted from 0, if the numbers of agents agree.
    pub fn at(place: usize, agents: usize) -> Option<Self> {
        EVENTS.get(place).filter(|set| set.len() == agents).map(|_| Self(place))
    }

    /// Returns the failures and successes of an agent.
    pub fn events(self, agent: usize) -> (usize, usize) {
        EVENTS[self.0][agent]
    }

    /// Returns the score of one agent alone.
    pub fn local(self, agent: usize, choice: Choice) -> Option<PublishedScore> {
        let tables = if self.0 == 0 { LOCAL.as_slice() } else { &[] };
        tables.get(agent).and_then(|table| entry(table, choice))
    }

    /// Returns the number of the paper's table of one agent alone.
    pub fn local_table(self, agent: usize) -> Option<&'static str> {
        if self.0 == 0 { LOCAL_TABLES.get(agent).copied() } else { None }
    }

    /// Returns the number of the paper's table of the team.
    pub fn team_table(self) -> &'static str {
        TEAM_TABLES[self.0]
    }

    /// Returns the score of the team.
    pub fn team(self, choice: Choice) -> Option<PublishedScore> {
        entry(&TEAM[self.0], choice)
    }
}

fn entry(table: &PaperTable, choice: Choice) -> Option<PublishedScore> {
    let policy = Policy::ALL.iter().position(|&policy| policy == choice.policy)?;
    table[policy].get(choice.points.checked_sub(1)?).map(|&(accuracy, nll)| PublishedScore { accuracy, nll })
}
