//! [`UnconfirmedNav`]: navigation whose time a later report must confirm.

use pingmap_agent::{Agent, Position};

use crate::protocol::input::Nav;

/// The first navigation after a start or gap, or far behind the clock. Its time may be wrong. A later time confirms it.
#[derive(Debug, Clone)]
pub(crate) struct UnconfirmedNav {
    pub(crate) nav: Nav,
    /// Its position on the chart.
    pub(crate) position: Position,
    /// The agent before this report.
    pub(crate) agent: Agent,
}
