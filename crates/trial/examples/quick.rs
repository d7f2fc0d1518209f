//! quick
#![allow(clippy::unwrap_used, clippy::print_stdout)]
use pingmap_agent::*;
use pingmap_trial::*;
fn main() {
    let a: Vec<String> = std::env::args().collect();
    let log = EventLog::open(a[1].as_ref()).unwrap();
    let splits = if a[2] == "-" { draw_splits(&log, 3, 0.35, 1) } else { read_splits(a[2].as_ref(), &log).unwrap() };
    let summary = if a[3] == "v" { SummaryKind::Variational } else { SummaryKind::Marginal };
    let plan = Plan {
        kernel: KernelChoice {
            shape: dgpc::Shape::SquaredExponential,
            reciprocal: true,
            length_scale_m: None,
            variance: None,
        },
        limits: Limits::default(),
        summary,
        fusion: if a.len() > 4 { Fusion::Concatenation } else { Fusion::Sites },
        points_per_frame: 4,
        frames_max: 0,
        seed: 1,
    };
    let t = std::time::Instant::now();
    let r = replay(&log, &splits, &[1, 2, 5, 10, 20], &plan, &|| ()).unwrap();
    println!("{:?}", t.elapsed());
    println!(
        "base {:.4} dist {:.4} own {:.4} central {:.4} true {:?}",
        r.base_rate.nll,
        r.distance_only.nll,
        r.own.nll,
        r.centralised.nll,
        r.true_probability.map(|s| s.nll)
    );
    for s in &r.sharing {
        println!("{:3} {:.4} worst {:.4} gap {:?}", s.frames, s.team.nll, s.worst_vehicle_nll, s.gap_closed);
    }
    for s in &r.splits {
        println!("{} {} {:.0} {} {:?}", s.name, s.training_events, s.length_scale_m, s.variance, s.evidence);
    }
}
