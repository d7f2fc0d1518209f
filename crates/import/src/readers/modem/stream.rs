//! Sentences of one modem as they arrive, for a vehicle under way.

use pingmap_agent::VehicleId;

use crate::model::modem_ids::ModemIds;
use crate::model::recording::Recording;
use crate::readers::modem::cycle::FRAME_S_MAX;
use crate::readers::modem::micromodem::Micromodem;
use crate::readers::modem::nmea::Sentence;
use crate::readers::sink::Sink;

/// Interprets the sentences between a host and its Micro-Modem one by one, as the import of a recording does.
#[derive(Debug)]
pub struct ModemStream {
    ids: ModemIds,
    modem: Micromodem,
    recording: Recording,
}

/// Receptions, transmissions and deaf intervals that sentences have shown since the last ones.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct ModemNews {
    /// Times of decoded messages, in seconds, and their senders.
    pub receptions: Vec<(f64, VehicleId)>,
    /// Times of transmissions of this modem, in seconds. They are known some seconds later, because a modem may revoke
    /// them.
    pub transmissions_s: Vec<f64>,
    /// Intervals in which the modem could not receive, and the reason.
    pub deaf_intervals: Vec<(f64, f64, String)>,
}

impl ModemStream {
    /// Creates a stream without sentences. `ids` names the vehicles behind modem ids.
    pub fn new(ids: ModemIds) -> Self {
        Self { ids, modem: Micromodem::default(), recording: Recording::default() }
    }

    /// Absorbs a sentence in either direction. The time is by the clock of the host, in seconds.
    ///
    /// # Errors
    /// The expected form, for a text without a sentence, or with a wrong checksum.
    pub fn absorb(&mut self, time_s: f64, text: &str) -> Result<ModemNews, &'static str> {
        let sentence = Sentence::parse(text).ok_or("a sentence that begins with $ and has a right checksum")?;
        self.modem.absorb(time_s, &sentence, Sink { recording: &mut self.recording, ids: &self.ids });
        Ok(self.take_news(time_s - FRAME_S_MAX))
    }

    /// Ends messages that began before a time, and returns what they show. Later sentences about them have no effect.
    pub fn finish_before(&mut self, time_s: f64) -> ModemNews {
        self.modem.finish_before(time_s, Sink { recording: &mut self.recording, ids: &self.ids });
        self.take_news(time_s)
    }

    /// Returns receptions and deaf intervals, and transmissions before a time, which are final.
    fn take_news(&mut self, final_s: f64) -> ModemNews {
        let arrivals = self.recording.arrivals.as_mut().map(std::mem::take).unwrap_or_default();
        let decoded = arrivals.into_iter().filter(|arrival| arrival.good);
        let deaf = std::mem::take(&mut self.recording.deaf_intervals);
        let mut transmissions_s = Vec::new();
        if let Some(transmissions) = &mut self.recording.transmissions {
            transmissions.retain(|transmission| {
                let is_final = transmission.time_s < final_s;
                transmissions_s.extend(is_final.then_some(transmission.time_s));
                !is_final
            });
        }
        // Other parts of a recording are not used here.
        self.recording.modem_activity.clear();
        self.recording.replies.clear();
        self.recording.bands.clear();
        self.recording.clock_syncs.clear();
        ModemNews {
            receptions: decoded.map(|arrival| (arrival.time_s, arrival.source)).collect(),
            transmissions_s,
            deaf_intervals: deaf
                .into_iter()
                .map(|(from_s, to_s, reason)| (from_s, to_s, reason.description().into()))
                .collect(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn receptions_and_transmissions_are_those_of_the_sentences() {
        let ids =
            ModemIds::from_pairs([("1", "auv1"), ("2", "auv2")].map(|(id, name)| (id.into(), VehicleId::new(name))));
        let mut modem = ModemStream::new(ids);
        let mut absorb = |time_s: f64, text: &str| modem.absorb(time_s, text).unwrap();
        absorb(1.0, "$CACYC,0,2,1,0,0,1");
        assert_eq!(absorb(4.0, "$CARXD,2,1,0,1,00FF").receptions, []);
        // The message ends with its statistics, or with the next cycle.
        let news = absorb(10.0, "$CCCYC,0,1,2,0,0,1");
        assert_eq!(news.receptions, [(4.0, VehicleId::new("auv2"))]);
        absorb(10.5, "$CCTXD,1,2,0,AABB");
        absorb(11.0, "$CATXP,2");
        assert_eq!(absorb(14.0, "$CATXF,2").transmissions_s, [] as [f64; 0]);
        assert_eq!(absorb(30.0, "$CAREV,120030,AUV,0.92").transmissions_s, [11.0]);
        // A message without any later sentence.
        absorb(41.0, "$CACYC,0,2,1,0,0,1");
        assert_eq!(absorb(44.0, "$CARXD,2,1,0,1,00FF").receptions, []);
        assert_eq!(modem.finish_before(40.0), ModemNews::default());
        assert_eq!(modem.finish_before(50.0).receptions, [(44.0, VehicleId::new("auv2"))]);
        assert!(modem.absorb(31.0, "$CARXD,2,1,0,1,00FF*00").is_err());
    }
}
