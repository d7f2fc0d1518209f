//! Time spans of damaged places in a log.

/// Finds the time spans in which records of a log were lost.
#[derive(Debug, Default)]
pub(crate) struct LostSpans {
    /// Time of the latest readable record, in seconds.
    last_s: Option<f64>,
    /// Whether a damaged place follows the latest readable record.
    is_open: bool,
    /// Start of the first span.
    first_s: Option<f64>,
    /// Whether records of a topic can no longer be read, because its definition was lost.
    is_topic_lost: bool,
    spans: Vec<(f64, f64)>,
}

impl LostSpans {
    /// Notes a damaged place after the records so far.
    pub(crate) fn note_damage(&mut self) {
        self.is_open = true;
        self.first_s.get_or_insert(self.last_s.unwrap_or(f64::NEG_INFINITY));
    }

    /// Notes the time of a readable record. It ends the span of a damaged place.
    pub(crate) fn note_record(&mut self, time_s: f64) {
        if std::mem::take(&mut self.is_open) {
            let from_s = self.last_s.unwrap_or(f64::NEG_INFINITY);
            self.spans.push((from_s.min(time_s), from_s.max(time_s)));
        }
        self.last_s = Some(time_s);
    }

    /// Notes a record of a topic without a definition. If a place is damaged, the definition was lost there, and so
    /// were all records of this topic since.
    pub(crate) fn note_undefined_topic(&mut self) {
        self.is_topic_lost |= self.first_s.is_some();
    }

    /// Returns the spans. A place at the end of the log has none, because no record follows.
    pub(crate) fn into_spans(mut self) -> Vec<(f64, f64)> {
        let rest = self.first_s.zip(self.last_s).filter(|_| self.is_topic_lost);
        self.spans.extend(rest);
        self.spans
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_span_reaches_from_the_record_before_damage_to_the_record_after_it() {
        let mut spans = LostSpans::default();
        spans.note_record(1.0);
        spans.note_record(2.0);
        spans.note_damage();
        spans.note_damage();
        spans.note_record(5.0);
        spans.note_record(6.0);
        spans.note_damage();
        assert_eq!(spans.into_spans(), [(2.0, 5.0)]);
    }

    #[test]
    fn damage_that_loses_a_definition_loses_the_rest_of_the_log() {
        let mut spans = LostSpans::default();
        spans.note_undefined_topic();
        spans.note_damage();
        for time_s in [5.0, 6.0, 7.0] {
            spans.note_record(time_s);
        }
        spans.note_undefined_topic();
        spans.note_record(8.0);
        assert_eq!(spans.into_spans(), [(f64::NEG_INFINITY, 5.0), (f64::NEG_INFINITY, 8.0)]);
    }
}
