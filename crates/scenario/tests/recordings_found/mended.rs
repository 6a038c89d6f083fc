//! What a recording lacks: the sign of its specific force, samples of a slower magnetometer, and time.

use cardan_scenario::Stimulus as _;

use crate::swing::*;

#[test]
fn gravity_is_turned_round_when_the_user_says_so_and_not_twice() {
    let turned = in_units(HEADER, [1.0, -1.0, 1.0]);
    let set = [("motion.recording.acc_is_gravity", 1.0)];
    assert_same("gravity", turned.as_bytes(), &set, 2e-6);
    // South of the equator it is right as it is.
    let (_folder, path) = file(turned.as_bytes());
    let south = open_with(&path, &[("motion.recording.acc_is_gravity", 0.0)]).expect("read");
    assert!(south.field().vertical_ut < -30.0);
    // With a reference there is no doubt.
    let header = format!("{HEADER},ref_qw,ref_qx,ref_qy,ref_qz");
    for (sign, is_right) in [(1.0, true), (-1.0, false)] {
        let text = table(&header, ",", |_, v| {
            let half = 0.5 * libm::asin(v[2] / G);
            let mut cells = plain([v[0], v[1], sign * v[2], sign * v[3], v[4], v[5], v[6]]);
            cells.extend([libm::cos(half), libm::sin(half), 0.0, 0.0].map(|q| format!("{q:.9}")));
            cells
        });
        let (_folder, path) = file(text.as_bytes());
        for stated in [None, Some(0.0), Some(1.0)] {
            let set: Vec<_> = stated
                .iter()
                .map(|&v| ("motion.recording.acc_is_gravity", v))
                .collect();
            let expected = is_right != (stated == Some(1.0));
            let found = open_with(&path, &set);
            assert_eq!(
                found.is_ok(),
                expected,
                "{sign} {stated:?}: {:?}",
                found.err()
            );
            if let Err(error) = found {
                assert!(error.contains("motion.recording.acc_is_gravity"), "{error}");
            }
        }
    }
}

#[test]
fn a_slower_magnetometer_is_interpolated_on_demand() {
    let slow = table(HEADER, ",", |k, v| {
        let mut cells = plain(v);
        if k % 5 != 2 {
            cells[4..].fill(String::new());
        }
        cells
    });
    assert_refused(
        "slow",
        slow.as_bytes(),
        &[
            "line 2",
            "mag_x_uT",
            "--set motion.recording.interpolate_mag=true",
        ],
    );
    // The first two rows go; the rest is 8 ms later then.
    let (_folder, path) = file(slow.as_bytes());
    let found = open_with(&path, &[("motion.recording.interpolate_mag", 1.0)]).expect("read");
    let (_kept, contract) = file(table(HEADER, ",", |_, v| plain(v)).as_bytes());
    let expected = open_with(&contract, &[]).expect("read");
    for step in 0..100 {
        let t = 0.05 + 0.055 * f64::from(step);
        let (a, b) = (expected.at(t + 0.008), found.at(t));
        for axis in 0..3 {
            assert!((a.specific_force_g[axis] - b.specific_force_g[axis]).abs() < 1e-5);
            // A straight line over 20 ms misses a curvature of 27 uT/s^2 by 1.4 nT.
            assert!(
                (a.field_ut[axis] - b.field_ut[axis]).abs() < 0.01,
                "{t} {a:?} {b:?}"
            );
        }
    }
    let partly = slow.replace(",,,\n0.004000", ",1.0,,\n0.004000");
    let (_folder, path) = file(partly.as_bytes());
    let error = open_with(&path, &[("motion.recording.interpolate_mag", 1.0)]);
    assert!(error.expect_err("one cell of three").contains("mag_y_uT"));
}

#[test]
fn gaps_are_told_and_no_solution_that_sees_one_counts() {
    let rows: Vec<String> = table(HEADER, ",", |_, v| plain(v))
        .lines()
        .map(str::to_owned)
        .collect();
    let text = [&rows[..501], &rows[751..1000], &rows[1010..]]
        .concat()
        .join("\n");
    let (_folder, path) = file(text.as_bytes());
    let found = open_with(&path, &[]).expect("read");
    let remark = found.remark().expect("two gaps");
    // From 1.996 to 3.000 s and from 3.992 to 4.036 s.
    for part in [
        "2 gaps",
        "1.048 s in all",
        "1.004 s after line 501 (1.996 s)",
    ] {
        assert!(remark.contains(part), "{remark}");
    }
    // 500 rows end at 1.996 s; the next is at 3.0 s.
    for (from, to, is_bridged) in [
        (1.5, 1.99, false),
        (1.9, 2.1, true),
        (2.4, 2.5, true),
        (2.95, 3.05, true),
        (3.05, 3.06, true),
        (3.11, 3.2, false),
    ] {
        assert_eq!(found.is_bridged(from, to), is_bridged, "{from} to {to}");
    }
    // A longer gap is allowed on demand.
    let one = open_with(&path, &[("motion.recording.longest_gap_s", 0.5)]).expect("read");
    assert!(one.remark().expect("one gap").contains("1 gap "));
    let none = open_with(&path, &[("motion.recording.longest_gap_s", 2.0)]).expect("read");
    assert_eq!(none.remark(), None);
    assert!(!none.is_bridged(0.0, 6.0));
}
