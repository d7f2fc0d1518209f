//! `pingmap import`: sentences of modems that no reader knows.

use crate::common::mission::import;
use crate::common::*;

#[test]
fn unknown_sentences_are_named_in_a_warning_and_in_json() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let navigation = "time,x,y\n0,0,0\n400,100,0\n";
    file(folder, "auv1.nav.csv", navigation);
    file(folder, "auv2.nav.csv", navigation);
    let cycle = |slot: u32| {
        let time_s = 20 * slot;
        format!("{time_s}.0 $CATXD,1,127,0,2\n{time_s}.1 $CATXP,32\n{time_s}.9 $CATXF,32\n")
    };
    let sent: String = (1..10).map(cycle).collect();
    let heard: String = (1..10).map(|slot| format!("{}.2 $CARXD,1,127,0,1,AA\n", 20 * slot)).collect();
    file(folder, "auv1.log", format!("1 $CACFG,SRC,1\n{sent}250 $CACFG,SRC,1\n"));
    let rows = |rest: &str| format!("1 $CACFG,SRC,2\n{heard}{rest}250 $CACFG,SRC,2\n");
    file(
        folder,
        "auv2.log",
        rows("245 $CAJRX,1,1,127,0,00,1,1,AA\n246 $CAJRX,1,1,127,0,00,1,1,BB\n247 $CATJN,0,1,0,00,AA\n"),
    );
    file(folder, "ids.csv", "id,name\n127,broadcast\n");
    let options = "auv1=auv1.log auv2=auv2.log auv1=auv1.nav.csv auv2=auv2.nav.csv --ids ids.csv --nav-gap-s-max 500";
    let (found, warnings) = import(folder, options);
    assert_eq!(found["heard"], 9);
    assert_eq!(found["left_out"]["unknown_sentences"], serde_json::json!({"CAJRX": 2, "CATJN": 1}));
    assert!(
        warnings.contains("3 sentences of a modem left out") && warnings.contains("(2 CAJRX, 1 CATJN)"),
        "{warnings}"
    );
    file(folder, "auv2.log", rows("247 $CAMFD,1,2,3,4\n"));
    let (found, warnings) = import(folder, options);
    assert_eq!(found["left_out"]["unknown_sentences"], serde_json::json!({}));
    assert!(!warnings.contains("left out"), "{warnings}");
}
