//! Faults of the simulation itself, which show that the checkers work, and faults of one member.

/// A planted fault, or a change of the world.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Sabotage {
    None,
    /// Some records are acknowledged without being stored.
    LoseRecord,
    /// After a restart the last event is recorded again.
    CountTwice,
    /// A restart leaves out the last record.
    ForgetOnRestart,
    /// Forged frames have a right tag.
    LeakKey,
    /// A restart leaves out the frames that were sent.
    ReuseCounters,
    /// The vehicles store more events than the team allows.
    RaiseLimit,
    /// Hosts report that they did not listen in slots that they missed.
    HideMisses,
    /// All other members report reversed outcomes, and no vehicle excludes any.
    TrustLiars,
    /// The clocks of all hosts are three hours ahead again and again, and at the end.
    AdvanceClocks,
    /// The first vehicle mutes the second one.
    Mute,
    /// The first vehicle does not receive the frames of the second one.
    DropFrames,
}

/// A fault of one member.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Fault {
    None,
    /// It hears nothing.
    Deaf,
    /// It reports that it heard everything.
    AllHeard,
    /// It reports the opposite of every outcome.
    Inverted,
    /// Its positions are wrong by 300 metres.
    WrongDatum,
    /// Its clock is ahead by three hours for some time.
    ClockJump,
}

pub const FAULTS: [Fault; 6] =
    [Fault::None, Fault::ClockJump, Fault::Deaf, Fault::Inverted, Fault::AllHeard, Fault::WrongDatum];
