//! The names of Micro-Modem sentences.

/// Sentences that hold no data of the user, without `CA` (from the modem) or `CC` (from the host): commands,
/// configuration, statistics, ranging, acknowledgements and parts of a cycle. Sources: Goby's driver (interface guide
/// 3.04), and WHOI's package `acomms` 3.1.1.
const WITHOUT_DATA: [&str; 71] = [
    "ACK", "AGC", "ALQ", "BBD", "BDD", "CDR", "CFG", "CFQ", "CFR", "CLK", "CLQ", "CMD", "CMR", "CST", "CYC", "DBG",
    "DOP", "DQF", "DRQ", "ERR", "EXL", "FFL", "FST", "HBR", "HIB", "IRE", "MEA", "MEC", "MER", "MFD", "MIZ", "MPA",
    "MPC", "MPR", "MSA", "MSC", "MSE", "MSG", "MSQ", "MSR", "MUR", "PDT", "PGT", "PNT", "PST", "RBR", "RBS", "REV",
    "RSP", "RXP", "SDO", "SED", "SEL", "SEN", "SFE", "SFL", "SHF", "SIF", "SNR", "SST", "SWP", "SWT", "TMG", "TMQ",
    "TMS", "TOA", "TRC", "TTA", "TXF", "TXP", "USB2",
];

/// Returns whether a sentence of a modem or its host, which no reader absorbs, may hold data of the user.
pub(super) fn may_hold_data(name: &str) -> bool {
    name.strip_prefix("CA").or_else(|| name.strip_prefix("CC")).is_some_and(|id| !WITHOUT_DATA.contains(&id))
}
