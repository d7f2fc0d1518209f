//! Features of sharing.

/// How a vehicle shares its data. Each feature has its own switch, so that its benefit can be measured.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Sharing {
    /// Send summaries: Gaussian messages at inducing points, for events that no report carries.
    pub summaries: bool,
    /// Send reports: single outcomes by slot, and the vehicle's track. They need a schedule.
    pub reports: bool,
    /// Use reports of other members as acknowledgements, so that delivered outcomes are not sent again.
    pub acknowledgements: bool,
    /// Compare several candidate reports by the divergence that remains after them. Otherwise the most valuable report
    /// is sent: the one with the most expected new deliveries.
    pub report_candidates: bool,
    /// Compare several summaries, whose inducing points come from different pools of events, by the divergence that
    /// remains after them. Otherwise one summary is made, whose points are chosen among all events.
    pub summary_candidates: bool,
}

impl Default for Sharing {
    /// Enables every feature.
    fn default() -> Self {
        Self {
            summaries: true,
            reports: true,
            acknowledgements: true,
            report_candidates: true,
            summary_candidates: true,
        }
    }
}

impl Sharing {
    /// Enables every feature but reports.
    pub fn summaries() -> Self {
        Self { reports: false, ..Self::default() }
    }

    /// Enables every feature but summaries.
    pub fn reports() -> Self {
        Self { summaries: false, ..Self::default() }
    }
}
