//! Answers to queries.

use pingmap_agent::{Interval, Kind, Link, LinkQuery, MessageKind, Time, VehicleId};

use crate::protocol::fault::{Fault, FaultCode};
use crate::protocol::input::{LINKS_MAX, Predict};
use crate::protocol::output::{Answer, Message};
use crate::protocol::place::End;
use crate::vehicle::slots::failed;
use crate::vehicle::state::Vehicle;
use crate::vehicle::trust::distrust;

impl Vehicle {
    /// Answers a query.
    pub(crate) fn predict(&mut self, query: &Predict) -> Result<(), Fault> {
        if query.links.len() > LINKS_MAX {
            let expected = format!("at most {LINKS_MAX} links");
            return Err(Fault::of_field(FaultCode::OutOfBounds, "links", query.links.len(), expected));
        }
        let link_query = |index: usize| self.query(query, index);
        let queries: Vec<LinkQuery> = (0..query.links.len()).map(link_query).collect::<Result<_, Fault>>()?;
        self.refit_if_due();
        self.forget_scores_of_unused_slots();
        let predictions = self.agent.predict_intervals(queries.clone()).map_err(|error| failed(&error))?;
        let trust = self.scores.trust();
        let reason = distrust(&trust);
        // Before any event the answer is that of the conservative range, if the configuration has one.
        let is_without_events = self.scores.is_empty() && !self.has_events();
        let is_conservative = is_without_events && self.config.conservative_range_m.is_some();
        let mut links = Vec::with_capacity(predictions.len());
        for (query, prediction) in queries.iter().zip(predictions) {
            let by_range = self.probability_by_range(&query.link);
            let probability = if is_conservative { by_range } else { prediction.probability };
            let (low, high) = prediction.interval.map_or((0.0, 1.0), |Interval { low, high, .. }| (low, high));
            let (low, high) = (low.min(probability), high.max(probability));
            let (explained, trusted, reason) = (prediction.explained, reason.is_none(), reason.clone());
            links.push(Answer { probability, low, high, explained, by_range, trusted, reason });
        }
        self.send(Message::Prediction { input: self.inputs, trust, links });
        Ok(())
    }

    /// Returns whether the map has any event, own or of others. Summaries do not count.
    fn has_events(&self) -> bool {
        self.counting_events().next().is_some() || self.agent.status().located_events > 0
    }

    fn query(&self, query: &Predict, index: usize) -> Result<LinkQuery, Fault> {
        let link = &query.links[index];
        let end = |name: &str, end: &End| {
            let field = format!("links[{index}].{name}");
            match end {
                End::Place(place) => self.position(&field, place),
                End::Member(id) => self.latest_position(id).ok_or_else(|| {
                    let expected = "a member or this vehicle with a known position";
                    Fault::of_field(FaultCode::WrongPlace, &field, id.as_str(), expected)
                }),
            }
        };
        let (transmitter, receiver) = (end("from", &link.from)?, end("to", &link.to)?);
        let mut link_query = LinkQuery::from(Link { transmitter, receiver });
        let named = |end: &End| match end {
            End::Member(id) => Some(<&VehicleId>::into(id)),
            End::Place(_) => None,
        };
        link_query.transmitter = named(&link.from).unwrap_or_default();
        link_query.receiver = named(&link.to).unwrap_or_default();
        link_query.when = query.time.map_or(Time::Typical, Time::At);
        link_query.kind = query.kind.as_deref().map_or(Kind::Typical, |kind| Kind::from(&MessageKind::new(kind)));
        Ok(link_query)
    }
}
