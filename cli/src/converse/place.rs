//! Where the members of a conversation stand.

use std::f32::consts::{FRAC_PI_2, PI};
use std::path::Path;

use umo_core::{Place, Skeleton};

use crate::failure::Failure;

/// Distance between neighbours on the half circle, metres.
const APART: f32 = 1.2;
/// Joints of the left foot and the left eye.
const FOOT: usize = 10;
const EYE: usize = 23;

/// Returns the places that a text or a file gives, or a half circle.
pub(super) fn places(given: Option<&str>, members: usize) -> Result<Vec<Place>, Failure> {
    let Some(given) = given else { return Ok(half_circle(members)) };
    let text = match Path::new(given).is_file() {
        true => std::fs::read_to_string(given).map_err(|cause| Failure::Input(format!("--places {given}: {cause}")))?,
        false => given.to_owned(),
    };
    let places = text.split_whitespace().map(parse).collect::<Result<Vec<_>, _>>()?;
    match places.len() == members {
        true => Ok(places),
        false => Err(Failure::Input(format!("--places has {} places for {members} members", places.len()))),
    }
}

/// Parses `X,Z,DEGREES`.
pub(crate) fn parse(text: &str) -> Result<Place, Failure> {
    let numbers: Option<Vec<f32>> = text.split(',').map(|number| number.trim().parse().ok()).collect();
    match numbers.as_deref() {
        Some(&[x, z, degrees]) if [x, z, degrees].iter().all(|number| number.abs() <= 1000.0) => {
            Ok(Place { position: [x, 0.0, z], facing: degrees.to_radians(), ..Place::default() })
        }
        _ => Err(Failure::Input(format!("`{text}`: expected a place X,Z,DEGREES, as -0.6,0,90, or a file of places"))),
    }
}

/// Members on a half circle that is open to +Z, from the left of who looks from there to the right; all face its centre.
pub(crate) fn half_circle(members: usize) -> Vec<Place> {
    let step = PI / members.saturating_sub(1).max(1) as f32;
    let radius = 0.5 * APART / (0.5 * step).sin();
    let place = |member: usize| {
        let turn = step * member as f32 - FRAC_PI_2;
        let (sine, cosine) = turn.sin_cos();
        Place { position: [radius * sine, 0.0, -radius * cosine], facing: -turn, ..Place::default() }
    };
    (0..members).map(place).collect()
}

/// Height of the eyes of who stands, above the soles.
pub(crate) fn eye_height(skeleton: &Skeleton) -> f32 {
    let height = |joint: usize| {
        let (mut joint, mut height) = (joint, 0.0);
        loop {
            height += skeleton.offsets_m[joint][1];
            match usize::try_from(skeleton.parents[joint]) {
                Ok(parent) => joint = parent,
                Err(_) => return height,
            }
        }
    };
    height(EYE) - height(FOOT)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_half_circle_faces_its_centre_and_neighbours_are_near() {
        for members in 2..=32 {
            let places = half_circle(members);
            let distance = |a: &Place, b: &Place| (a.position[0] - b.position[0]).hypot(a.position[2] - b.position[2]);
            assert!(places.windows(2).all(|pair| (distance(&pair[0], &pair[1]) - APART).abs() < 1e-3));
            for Place { position: [x, _, z], facing, .. } in &places {
                let radius = x.hypot(*z);
                let (sine, cosine) = facing.sin_cos();
                assert!((x + radius * sine).abs() < 1e-3 && (z + radius * cosine).abs() < 1e-3, "{x} {z} {facing}");
                assert!(*z < 1e-3, "nobody stands before the picture");
            }
            assert!(places[0].position[0] < 0.0 && places[members - 1].position[0] > 0.0);
        }
    }

    #[test]
    fn places_are_read_or_refused_in_words() {
        let found = places(Some("-0.6,0,90\n0.6,0.5,-90 "), 2).unwrap();
        assert_eq!((found[0].position, found[1].position), ([-0.6, 0.0, 0.0], [0.6, 0.0, 0.5]));
        assert!((found[0].facing - FRAC_PI_2).abs() < 1e-6);
        for (text, word) in
            [("1,2,3", "1 places for 2"), ("1,2 3,4", "`1,2`: expected a place"), ("1,2,nan 0,0,0", "nan")]
        {
            let Err(Failure::Input(problem)) = places(Some(text), 2) else { panic!("{text} was accepted") };
            assert!(problem.contains(word), "{problem}");
        }
    }
}
