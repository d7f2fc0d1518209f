//! Charts, and reference systems of their coordinates.

use pingmap_agent::*;

#[test]
fn the_origin_is_round_and_central() {
    let chart = Chart::about([Position::new(431_000.0, 4_700_020.0), Position::new(431_180.0, 4_700_000.0)]);
    assert_eq!(chart.origin, Position::new(431_100.0, 4_700_000.0));
    assert_eq!(chart.local_m(&Position::new(431_110.0, 4_699_990.0)), (10.0, -10.0));
    assert_eq!(Chart::about([]).origin, Position::new(0.0, 0.0));
}

#[test]
fn the_scale_is_the_rms_distance_of_positions_from_their_mean() {
    let square = |half: f64| [(half, half), (half, -half), (-half, half), (-half, -half)];
    let chart = |half| Chart::about(square(half).map(|(east_m, north_m)| Position::new(east_m + 5e5, north_m)));
    assert_eq!(chart(500.0).scale_m, 710.0);
    assert!((chart(0.5).scale_m - 0.71).abs() < 1e-12);
    for nowhere in [Chart::about([]), chart(0.0), Chart::about([Position::new(3.0, 4.0)])] {
        assert_eq!(nowhere.scale_m, SCALE_FALLBACK_M);
    }
}

#[test]
fn a_few_positions_far_away_do_not_count_and_a_moored_receiver_hides_none() {
    let near = |n: usize| Position::new((n * 37 % 1000) as f64, (n * 61 % 1000) as f64);
    let without = Chart::about((0..200).map(near));
    let far = Position::new(1.1e7, -4.9e6);
    let with = Chart::about((0..200).map(near).chain([far]));
    assert_eq!(with, without);
    let many = Chart::about((0..200).map(near).chain([far; 20]));
    assert!(many.scale_m > 1e6, "two areas are no mistake");

    // Half of all ends lie at a mooring, and the other vehicle goes 20 km away.
    let ends = (0..200).flat_map(|n| [Position::new(0.0, 0.0), Position::new(n as f64 * 100.0, 0.0)]);
    assert!(Chart::about(ends).scale_m > 6_000.0);
}

#[test]
fn systems_agree_to_a_metre() {
    let about = |text: &str| text.parse::<ReferenceSystem>().unwrap();
    let (origin, utm) = (about("41.52,-70.67"), about("EPSG:32619"));
    for (other, is_same) in [
        ("41.519999987301745,-70.66999999783731", true),
        ("41.520008,-70.67", true),
        ("41.520010,-70.67", false),
        ("41.52,-70.670010", true),
        ("41.52,-70.670013", false),
        ("unknown", true),
        ("EPSG:32619", false),
    ] {
        assert_eq!(origin.agrees_with(&about(other)), is_same, "{other}");
        assert_eq!(about(other).agrees_with(&origin), is_same, "{other}");
    }
    assert!(utm.agrees_with(&utm) && !utm.agrees_with(&about("EPSG:32618")));
    assert!(about("0,180").agrees_with(&about("0,-180")));
}

#[test]
fn systems_round_trip_through_their_text_form() {
    let point = Geographic { latitude_deg: -17.123_456_789, longitude_deg: 179.5 };
    for system in [ReferenceSystem::Unknown, ReferenceSystem::About(point), ReferenceSystem::Epsg(32_719)] {
        assert_eq!(system.to_string().parse(), Ok(system));
    }
    assert_eq!(" epsg:3067 ".parse(), Ok(ReferenceSystem::Epsg(3067)));
    // Longitudes may count to 360.
    let west = Geographic { latitude_deg: 0.0, longitude_deg: -179.0 };
    assert_eq!("0,181".parse(), Ok(ReferenceSystem::About(west)));
    for invalid in ["", "EPSG:", "EPSG:x", "epsg", "91,0", "0,361", "1", "1,2,3", "NaN,0", "é,1", "ééé"] {
        assert_eq!(invalid.parse::<ReferenceSystem>(), Err(NoReferenceSystem(invalid.into())));
    }
}
