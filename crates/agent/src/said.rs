//! What packets say, and how surprising that is.

use std::collections::BTreeSet;
use std::sync::Arc;

use dgpc::{Posterior, Shift, Summary};

use crate::agent_error::AgentError;
use crate::memory::Memory;
use crate::packets::{Packet, PacketKey};

/// Ears differ: an offset of a member, common to all that it says, surprises only where it is beyond this many logits.
const OFFSET_SD: f64 = 0.5;

/// The packets of these names, the vehicle's own and those of others.
pub(crate) fn told_and_heard<'a>(
    memory: &Memory,
    keys: impl IntoIterator<Item = &'a PacketKey> + Clone,
) -> [Vec<Arc<Packet>>; 2] {
    let part =
        |is_own: bool| said(memory, keys.clone().into_iter().filter(move |key| (Some(key.0) == memory.own) == is_own));
    [part(true), part(false)]
}

/// The packets of these names.
pub(crate) fn said<'a>(memory: &Memory, keys: impl Iterator<Item = &'a PacketKey>) -> Vec<Arc<Packet>> {
    keys.filter_map(|&key| memory.packets.get(key).cloned()).collect()
}

/// What packets say.
pub(crate) fn summaries(packets: &[Arc<Packet>]) -> Vec<&Summary> {
    packets.iter().flat_map(|packet| &packet.summaries).collect()
}

/// How far what a member says moves a posterior, in standard deviations of what is known without it.
pub(crate) fn surprise(
    posterior: &Posterior,
    memory: &Memory,
    heard: &BTreeSet<PacketKey>,
    member: u8,
    shift: impl Fn(&Posterior, &[&Summary]) -> dgpc::Result<Shift>,
) -> Result<f64, AgentError> {
    let packets = said(memory, heard.range((member, 0)..=(member, u16::MAX)));
    let prior = posterior.prior();
    let read = summaries(&packets).into_iter().map(|summary| summary.read_under(prior));
    let read: Vec<_> = read.collect::<Result<_, dgpc::Error>>()?;
    match shift(posterior, &read.iter().map(AsRef::as_ref).collect::<Vec<_>>()) {
        Ok(shift) => Ok(shift.largest(OFFSET_SD)),
        // So much certainty that nothing can be told of what would be known without it.
        Err(dgpc::Error::NotPositiveDefinite { .. }) => Ok(f64::INFINITY),
        Err(error) => Err(error.into()),
    }
}
