//! Damage by one faulty member, and the benefit of its exclusion.

mod faults;

use std::io::Write;

use clap::{Args, ValueEnum};
use pingmap_agent::{Agent, AgentError, IgnoreReason, Key, Learning, Sharing, Team};
use pingmap_trial::{EventLog, Mission, Plan, Preshared, Split, probabilities};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;

use crate::agents::receive_from_others;
use crate::arguments::LogFiles;
use crate::statistics::{mean, nll};
use faults::{FAULTS, FAULTY_RECEIVERS, FaultyMember, REPORT_FAULTS};

/// Number of packets of each member.
const PACKETS: usize = 10;

/// Measures the damage by one faulty member, and the benefit of excluding it.
///
/// In every split each vehicle in turn is the faulty member. With `majority`, every member but one has the fault. The
/// table has the mean NLL of all other vehicles over all held-out events: from own events alone, from the ten
/// authenticated packets of every member, and with exclusion by default. Three more columns follow: how often the
/// faulty member was excluded, how many other members were excluded, and the range of the faulty member's discrepancy.
#[derive(Debug, Args)]
pub(crate) struct Arguments {
    #[command(flatten)]
    log: LogFiles,
    /// The only table to compute; all four without it
    table: Option<Packets>,
}

/// Packets of a member with a fault: the title of a table.
#[derive(Debug, Clone, Copy, PartialEq, ValueEnum)]
enum Packets {
    Summaries,
    Reports,
    Both,
    /// Reports; every member but one has the fault
    Majority,
}

impl Packets {
    fn title(self) -> &'static str {
        match self {
            Self::Summaries => "summaries",
            Self::Reports => "reports",
            Self::Both => "both",
            Self::Majority => "majority",
        }
    }

    fn sharing(self) -> Sharing {
        match self {
            Self::Summaries => Sharing::summaries(),
            Self::Reports | Self::Majority => Sharing::reports(),
            Self::Both => Sharing::default(),
        }
    }

    fn faults(self) -> &'static [&'static str] {
        match self {
            Self::Summaries => &FAULTS,
            Self::Reports | Self::Majority => &REPORT_FAULTS,
            Self::Both => &FAULTY_RECEIVERS,
        }
    }
}

impl Arguments {
    pub(crate) fn run(&self, out: &mut dyn Write) -> anyhow::Result<()> {
        let (log, splits) = self.log.read()?;
        let is_wanted = |table: &&Packets| self.table.is_none_or(|wanted| wanted == **table);
        for &table in Packets::value_variants().iter().filter(is_wanted) {
            let mut outcomes = vec![Vec::new(); table.faults().len()];
            for (number, split) in splits.iter().enumerate() {
                measure(&log, split, number as u64, table, &mut outcomes)?;
            }
            let title = table.title();
            writeln!(out, "{title:15}  alone believed  default excluded  others  discrepancy")?;
            for (fault, outcomes) in table.faults().iter().zip(&outcomes) {
                writeln!(out, "{}", row(fault, outcomes))?;
            }
        }
        Ok(())
    }
}

/// Adds the results of each fault in one split to `outcomes`.
fn measure(
    log: &EventLog,
    split: &Split,
    number: u64,
    table: Packets,
    outcomes: &mut [Vec<Outcome>],
) -> anyhow::Result<()> {
    let team = HonestTeam::prepare(log, split, table.sharing())?;
    let (mission, count) = (&team.mission, team.mission.vehicles.len());
    for faulty in 0..count {
        let mut rng = ChaCha8Rng::seed_from_u64(100 * number + faulty as u64);
        for (fault, outcomes) in table.faults().iter().zip(&mut *outcomes) {
            let mut packets =
                |member: usize| FaultyMember::new(log, mission, table.sharing(), member).packets(fault, &mut rng);
            if table == Packets::Majority {
                let packets = (0..count).map(packets).collect::<Result<Vec<_>, _>>()?;
                outcomes.push(team.listen(faulty, (faulty + 1) % count, |sender| &packets[sender])?);
                continue;
            }
            let packets = packets(faulty)?;
            for listener in (0..count).filter(|&listener| listener != faulty) {
                let sent = |sender| if sender == faulty { &packets } else { &mission.packets[sender] };
                outcomes.push(team.listen(listener, faulty, sent)?);
            }
        }
    }
    Ok(())
}

/// A team without faults after learning.
struct HonestTeam {
    mission: Mission,
    /// The vehicles, with an exclusion threshold that no discrepancy reaches.
    without_exclusion: Vec<Agent>,
}

/// Results of a listener.
#[derive(Clone)]
struct Outcome {
    /// NLL from own events, without exclusion, and by default.
    nll: [f64; 3],
    is_excluded: bool,
    others_excluded: usize,
    discrepancy: f64,
}

impl HonestTeam {
    fn prepare(log: &EventLog, split: &Split, sharing: Sharing) -> anyhow::Result<Self> {
        let key = Some(Key::new(*b"the secret of a team of vehicles")?);
        let plan = Plan { key, sharing, ..Plan::new(Learning::default(), 1) };
        let mission = Mission::prepare(log, split, &plan, PACKETS)?;
        let team = Team { exclusion_threshold_sd: 1e9, ..(*mission.team).clone() };
        let plan = Plan { preshared: Preshared::Team(Box::new(team)), ..plan };
        let without_exclusion = Mission::prepare(log, split, &plan, 0)?.vehicles;
        Ok(Self { mission, without_exclusion })
    }

    /// Returns the results of a listener that receives these packets of all others, one of which is faulty.
    fn listen<'a>(
        &self,
        listener: usize,
        faulty: usize,
        packets: impl Fn(usize) -> &'a Vec<Vec<u8>>,
    ) -> Result<Outcome, AgentError> {
        let mission = &self.mission;
        let nll =
            |agent: &mut Agent| Ok::<_, AgentError>(nll(&probabilities(agent, &mission.held_out)?, &mission.outcomes));
        let mut without_exclusion = self.without_exclusion[listener].clone();
        let mut default = mission.vehicles[listener].clone();
        let alone = nll(&mut default)?;
        for agent in [&mut without_exclusion, &mut default] {
            receive_from_others(agent, listener, mission.vehicles.len(), &packets, mission.end_s)?;
        }
        let nll = [alone, nll(&mut without_exclusion)?, nll(&mut default)?];
        let id = mission.vehicles[faulty].id();
        let discrepancy = default.discrepancy(id)?.unwrap_or(0.0);
        let members = default.status().members;
        let is_excluded = members.get(id).is_some_and(|member| member.is_ignored(IgnoreReason::Contradicts));
        let excluded = members.values().filter(|member| member.is_ignored(IgnoreReason::Contradicts)).count();
        Ok(Outcome { nll, is_excluded, others_excluded: excluded - usize::from(is_excluded), discrepancy })
    }
}

fn row(fault: &str, outcomes: &[Outcome]) -> String {
    let mean = |value: fn(&Outcome) -> f64| mean(outcomes.iter().map(value));
    let discrepancies = || outcomes.iter().map(|outcome| outcome.discrepancy);
    format!(
        "{fault:15} {:>6.4} {:>8.4} {:>8.4} {:>8.2} {:>7.3}  {:.1} to {:.1}",
        mean(|outcome| outcome.nll[0]),
        mean(|outcome| outcome.nll[1]),
        mean(|outcome| outcome.nll[2]),
        mean(|outcome| f64::from(u8::from(outcome.is_excluded))),
        mean(|outcome| outcome.others_excluded as f64),
        discrepancies().fold(f64::INFINITY, f64::min),
        discrepancies().fold(0.0, f64::max)
    )
}
