//! Helper joints take their shares of a rotation, and cloth keeps its thickness.

use super::*;
use umo_core_pose::rotation::{IDENTITY, Quat, axis_angle_to_quat, inverse, product};
use umo_core_pose::skeleton::JOINTS;
use vector::{dot, length, scale, unit};

fn helper<'a>(mesh: &'a Mesh, name: &str) -> &'a Helper {
    mesh.helpers.iter().find(|helper| helper.name == name).unwrap()
}

fn angle_between(a: Quat, b: Quat) -> f32 {
    2.0 * product(inverse(a), b)[3].clamp(-1.0, 1.0).acos()
}

#[test]
fn helpers_take_their_shares_of_swing_and_twist() {
    let mesh = &FIGURES[0];
    let elbow = helper(mesh, "left_elbow_half").axis;
    let across = unit(vector::cross(elbow, [0.0, 0.3, 1.0]));
    let swing = axis_angle_to_quat(scale(across, 1.2));
    let twist = axis_angle_to_quat(scale(elbow, -0.9));
    let turn = product(swing, twist);
    for (name, of_swing, of_twist) in
        [("left_elbow_half", 0.6, 0.0), ("left_elbow_swing", 1.2, 0.0), ("left_elbow_twist", 1.2, -0.45)]
    {
        let wanted = product(axis_angle_to_quat(scale(across, of_swing)), axis_angle_to_quat(scale(elbow, of_twist)));
        let off = angle_between(helper(mesh, name).turn(turn), wanted);
        assert!(off < 2e-3, "{name} is {off} rad away");
    }
    for one in &mesh.helpers {
        assert!((length(one.axis) - 1.0).abs() < 1e-5);
        assert!(angle_between(one.turn(IDENTITY), IDENTITY) < 1e-3, "{}", one.name);
        // The same rotation with the opposite sign.
        assert!(angle_between(one.turn(turn.map(|x| -x)), one.turn(turn)) < 1e-3, "{}", one.name);
        let from_parent = if one.is_in_place() { product(turn, one.local_turn(turn)) } else { one.local_turn(turn) };
        assert!(angle_between(from_parent, one.turn(turn)) < 2e-3, "{}", one.name);
    }
}

#[test]
fn every_helper_has_skin_and_its_number() {
    for mesh in ALL.iter() {
        for (at, one) in mesh.helpers.iter().enumerate() {
            let number = skin::number(&one.name);
            assert_eq!(usize::from(number), JOINTS + at);
            let followers = mesh.joints.iter().zip(&mesh.weights);
            let most = followers.flat_map(|(joints, weights)| joints.iter().zip(weights));
            let most = most.filter(|one| *one.0 == number).map(|one| *one.1).fold(0.0, f32::max);
            assert!(most > 0.15, "{} moves no vertex by more than {most}", one.name);
        }
        assert!(mesh.joints.iter().flatten().all(|&joint| usize::from(joint) < JOINTS + mesh.helpers.len()));
    }
}

/// The smallest share of its distance from the bone that a sleeve's vertex keeps while a joint rotates about the bone
/// from `from` to `to`.
fn thinnest(mesh: &Mesh, turned: &str, [from, to]: [&str; 2], angle: f32) -> f32 {
    let skeleton = sample::skeleton();
    let rest = rest::Rest::new(&skeleton).unwrap();
    let (a, b) = (rest.side("left", from), rest.side("left", to));
    let along = unit(sub(b, a));
    let mut rotations = [IDENTITY; JOINTS];
    rotations[usize::from(skin::number(&format!("left_{turned}")))] = axis_angle_to_quat(scale(along, angle));
    let posed = mesh.posed(&skeleton, &rotations, [0.0; 3], &[]);
    let off = |p: V| {
        let from = sub(p, a);
        length(sub(from, scale(along, dot(from, along))))
    };
    let bone = distance(a, b);
    let of_sleeve = (0..mesh.head).filter(|&v| {
        let t = dot(sub(mesh.positions[v], a), along) / bone;
        (0.15..0.95).contains(&t) && (0.02..0.06).contains(&off(mesh.positions[v]))
    });
    of_sleeve.map(|v| off(posed.positions[v]) / off(mesh.positions[v])).fold(f32::MAX, f32::min)
}

/// Without helper joints, a twist of 90 degrees would thin a sleeve to 0.71 of its radius.
#[test]
fn a_twisted_arm_stays_as_thick_as_it_is() {
    for mesh in ALL.iter() {
        for (turned, degrees, bone) in [
            ("elbow", 90.0_f32, ["elbow", "wrist"]),
            ("wrist", 60.0, ["elbow", "wrist"]),
            ("shoulder", 90.0, ["shoulder", "elbow"]),
        ] {
            let thin = thinnest(mesh, turned, bone, degrees.to_radians());
            assert!(thin > 0.82, "{turned}: {thin} of the thickness is left");
        }
    }
}

/// A bent elbow and a bent knee keep their outline.
#[test]
fn bent_joints_keep_their_outside() {
    let skeleton = sample::skeleton();
    let rest = rest::Rest::new(&skeleton).unwrap();
    for mesh in ALL.iter() {
        for (joint, axis, outside) in
            [("elbow", [0.0, -1.0, 0.0], [0.0, 0.0, -1.0]), ("knee", [1.0, 0.0, 0.0], [0.0, 0.0, 1.0])]
        {
            let place = rest.side("left", joint);
            let at = mesh.positions[..mesh.head].iter().enumerate().filter(|(_, p)| distance(**p, place) < 0.075);
            let furthest = at.max_by(|a, b| dot(sub(*a.1, place), outside).total_cmp(&dot(sub(*b.1, place), outside)));
            let (vertex, p) = furthest.unwrap();
            let before = distance(*p, place);
            let mut rotations = [IDENTITY; JOINTS];
            rotations[usize::from(skin::number(&format!("left_{joint}")))] = axis_angle_to_quat(scale(axis, 1.5));
            let after = distance(mesh.posed(&skeleton, &rotations, [0.0; 3], &[]).positions[vertex], place);
            assert!(after > 0.88 * before, "{joint}: {after} m of {before} m");
        }
    }
}
