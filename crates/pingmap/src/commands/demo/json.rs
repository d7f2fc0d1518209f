//! The demo in JSON.

use schemars::JsonSchema;
use serde::Serialize;

use super::comparison::Row;
use crate::commands::replay::Replayed;
use crate::commands::replay::json::ReplayJson;

/// Result of the demo in JSON: the table, and the replay with event reports.
#[derive(Serialize, JsonSchema)]
pub struct DemoJson {
    #[serde(flatten)]
    replay: ReplayJson,
    /// The table of the demo, from no sharing to all events in one place.
    comparison: Vec<RowJson>,
}

#[derive(Serialize, JsonSchema)]
pub struct RowJson {
    /// Data from which each vehicle predicts.
    method: &'static str,
    /// Number of packets of each vehicle; absent without sharing.
    packets: Option<usize>,
    /// Mean number of bytes that each vehicle sends; absent for all events in one place.
    bytes: Option<f64>,
    /// Mean negative log-likelihood of held-out events, in nats.
    nll: f64,
    /// Standard error of `nll` over splits.
    nll_se: Option<f64>,
    /// Share of events whose more probable outcome occurred.
    acc: f64,
}

impl DemoJson {
    pub fn of(replayed: &Replayed, rows: &[Row]) -> Self {
        let row = |&Row { method, packets, bytes, score }: &Row| RowJson {
            method,
            packets,
            bytes,
            nll: score.nll.mean,
            nll_se: score.nll.se,
            acc: score.accuracy.mean,
        };
        Self { replay: ReplayJson::of(replayed), comparison: rows.iter().map(row).collect() }
    }
}
