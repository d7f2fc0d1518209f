//! Grids: every position and every time lies in its cell.

use pingmap_agent::*;

#[test]
fn every_position_lies_in_its_cell() {
    let corners = [(-812.0, 1499.0), (703.0, -1500.0), (0.0, 0.0)].map(|(east, north): (f64, f64)| Position {
        depth_m: Some(east.abs() / 10.0),
        ..Position::new(5e5 + east, 4e6 + north)
    });
    let chart = Chart::about(corners);
    let grid = Grid::covering(&chart, corners);
    for corner in corners {
        let cell = grid.cell(&chart, &corner).expect("the grid covers it");
        let centre = grid.position(&chart, cell, true);
        let distance = |a: f64, b: f64| (a - b).abs();
        assert!(distance(centre.east_m, corner.east_m) <= 0.5 * grid.cell_m + 1e-9, "{centre:?} {corner:?}");
        assert!(distance(centre.north_m, corner.north_m) <= 0.5 * grid.cell_m + 1e-9);
        let depths = (centre.depth_m.unwrap_or(0.0), corner.depth_m.unwrap_or(0.0));
        assert!(distance(depths.0, depths.1) <= 0.5 * grid.depth_cell_m + 1e-9, "{depths:?}");
        assert_eq!(grid.cell(&chart, &centre), Some(cell));
        let waypoint_cell = grid.waypoint_cell(&chart, &corner).expect("the grid covers it");
        let waypoint = grid.waypoint_position(&chart, waypoint_cell, true);
        let east_m = distance(waypoint.east_m, corner.east_m);
        assert!(east_m.max(distance(waypoint.north_m, corner.north_m)) <= 0.125 * grid.cell_m + 1e-9);
        let depth_m = distance(waypoint.depth_m.unwrap_or(0.0), corner.depth_m.unwrap_or(0.0));
        assert!(depth_m <= 0.25 * grid.depth_cell_m + 1e-9);
    }
    assert_eq!(grid.cell(&chart, &Position::new(5e5 + 40.0 * grid.cell_m, 4e6)), None);
    assert!(grid.cell_m * 32.0 < 1.1 * 1600.0, "{grid:?}");
}

#[test]
fn a_grid_without_positions_and_times_has_default_cells() {
    let grid = Grid::covering(&Chart::about([]), []);
    assert_eq!(grid, Grid { cell_m: 1.0, depth_cell_m: 1.0, start_s: 0.0, time_cell_s: 600.0 });
    assert_eq!(grid.spanning([f64::NAN, f64::INFINITY]), grid);
}

#[test]
fn every_time_lies_in_its_cell() {
    let times = [1.76e9, 1.76e9 + 11.0, 1.76e9 + 8765.4];
    let grid = Grid::covering(&Chart::about([]), []).spanning(times);
    assert_eq!(grid.time_cell_s, 140.0);
    for time_s in times {
        let cell = grid.time_cell(time_s);
        let Time::At(middle_s) = grid.when(cell) else { panic!("no cell contains {time_s}") };
        assert!((middle_s - time_s).abs() <= 0.5 * grid.time_cell_s, "{middle_s} {time_s}");
        assert_eq!(grid.time_cell(middle_s), cell);
    }
    for outside_s in [1.76e9 - 1.0, 1.76e9 + 9000.0, f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
        assert_eq!(grid.time_cell(outside_s), 0);
    }
    assert_eq!(grid.when(0), Time::Typical);
}
