use super::*;

/// Pairs of vertices at which the lips touch at rest: of the upper lip and of the lower one.
fn touching(mesh: &Mesh) -> Vec<[usize; 2]> {
    let open = shaped(mesh, &["jawOpen"]);
    let mut at: HashMap<[u32; 3], Vec<usize>> = HashMap::new();
    for v in mesh.head..mesh.positions.len() {
        at.entry(mesh.positions[v].map(f32::to_bits)).or_default().push(v);
    }
    let mut pairs: Vec<[usize; 2]> = at
        .into_values()
        .filter(|all| all.len() == 2)
        .map(|all| if open[all[0]][1] > open[all[1]][1] { [all[0], all[1]] } else { [all[1], all[0]] })
        .filter(|&[upper, lower]| open[upper][1] - open[lower][1] > 1e-4)
        .collect();
    pairs.sort_unstable();
    pairs
}

fn gap(mesh: &Mesh, names: &[&str]) -> f32 {
    let places = shaped(mesh, names);
    touching(mesh).iter().map(|&[upper, lower]| distance(places[upper], places[lower])).fold(0.0, f32::max)
}

/// The left corner of the mouth: the leftmost touching pair.
fn corner(mesh: &Mesh) -> usize {
    let pairs = touching(mesh);
    pairs.iter().map(|pair| pair[0]).max_by(|&a, &b| mesh.positions[a][0].total_cmp(&mesh.positions[b][0])).unwrap()
}

#[test]
fn an_open_jaw_parts_the_lips_and_mouth_close_joins_them() {
    for mesh in FIGURES.iter() {
        assert!(touching(mesh).len() > 15);
        assert!(gap(mesh, &["jawOpen"]) > 0.015);
        let closed = gap(mesh, &["jawOpen", "mouthClose"]);
        assert!(closed < 0.001, "the lips are {closed} m apart");
        let chin = |names: &[&str]| -> f32 {
            let rest = mesh.positions.iter().zip(shaped(mesh, names)).skip(mesh.head);
            rest.map(|(rest, now)| rest[1] - now[1]).fold(0.0, f32::max)
        };
        assert!(chin(&["jawOpen", "mouthClose"]) > 0.015, "the chin stays down");
    }
}

#[test]
fn a_smile_lifts_and_widens_the_corners_and_a_frown_lowers_them() {
    let mesh = &FIGURES[0];
    let corner = corner(mesh);
    let moved = |name: &str| sub(shaped(mesh, &[name])[corner], mesh.positions[corner]);
    let [smile, frown, stretch] = ["mouthSmileLeft", "mouthFrownLeft", "mouthStretchLeft"].map(moved);
    assert!(smile[0] > 0.003 && smile[1] > 0.003, "{smile:?}");
    assert!(frown[1] < -0.003, "{frown:?}");
    assert!(stretch[0] > 0.004, "{stretch:?}");
    assert_eq!(moved("mouthSmileRight"), [0.0; 3]);
    assert!(moved("mouthLeft")[0] > 0.003 && moved("mouthRight")[0] < -0.003);
}

#[test]
fn lips_that_gather_grow_narrower_and_come_forward() {
    let mesh = &FIGURES[0];
    let corner = corner(mesh);
    for name in ["mouthPucker", "mouthFunnel"] {
        let moved = morph(mesh, name);
        let ahead = moved.positions.iter().map(|by| by[2]).fold(0.0, f32::max);
        assert!(ahead > 0.006, "{name} comes {ahead} m forward");
        let by = sub(shaped(mesh, &[name])[corner], mesh.positions[corner]);
        assert!(by[0] < -0.004, "{name} moves the left corner by {by:?}");
    }
    assert!(gap(mesh, &["mouthFunnel"]) > 0.006, "a funnel is open");
    assert!(gap(mesh, &["mouthPucker"]) < 0.006, "a kiss is not");
}

#[test]
fn lip_shapes_move_only_their_lip() {
    let mesh = &FIGURES[0];
    let pairs = touching(mesh);
    let mean = |name: &str, which: usize| -> f32 {
        let places = shaped(mesh, &[name]);
        let left = pairs.iter().filter(|pair| (0.003..0.018).contains(&mesh.positions[pair[0]][0]));
        let moved: Vec<f32> = left.map(|pair| places[pair[which]][1] - mesh.positions[pair[which]][1]).collect();
        moved.iter().sum::<f32>() / moved.len() as f32
    };
    assert!(mean("mouthUpperUpLeft", 0) > 0.003 && mean("mouthUpperUpLeft", 1).abs() < 0.001);
    assert!(mean("mouthLowerDownLeft", 1) < -0.003 && mean("mouthLowerDownLeft", 0).abs() < 0.001);
    assert!(mean("mouthShrugLower", 1) > 0.002 && mean("mouthShrugUpper", 0) > 0.002);
    let back = |name: &str| morph(mesh, name).positions.iter().map(|by| by[2]).fold(0.0, f32::min);
    assert!(back("mouthRollLower") < -0.004 && back("mouthRollUpper") < -0.004, "rolled lips go in");
}

/// With left and right shapes together, the middle of a lip moves as far as its sides, so the lips keep their curve.
#[test]
fn pairs_of_shapes_leave_no_peak_in_the_middle_of_a_lip() {
    let mesh = &FIGURES[0];
    let pairs = touching(mesh);
    for (stem, which) in [("mouthLowerDown", 1), ("mouthUpperUp", 0)] {
        let names = [format!("{stem}Left"), format!("{stem}Right")];
        let places = shaped(mesh, &names.each_ref().map(String::as_str));
        let moved = |from: f32, to: f32| -> f32 {
            let near =
                pairs.iter().map(|pair| pair[which]).filter(|&v| (from..to).contains(&mesh.positions[v][0].abs()));
            let all: Vec<f32> = near.map(|v| (places[v][1] - mesh.positions[v][1]).abs()).collect();
            all.iter().sum::<f32>() / all.len() as f32
        };
        let (middle, beside) = (moved(0.0, 0.001), moved(0.008, 0.013));
        assert!(middle > 0.75 * beside, "{stem}: {middle} m in the middle, {beside} m beside it");
    }
}

#[test]
fn the_tongue_passes_the_lips() {
    let mesh = &FIGURES[0];
    let lips = touching(mesh).iter().map(|pair| mesh.positions[pair[0]][2]).fold(f32::MIN, f32::max);
    let out = morph(mesh, "tongueOut");
    let tip = out.vertices.iter().zip(&out.positions).filter(|(_, by)| by[2] > 0.02);
    let furthest = tip.map(|(&v, by)| mesh.positions[v as usize][2] + by[2]).fold(f32::MIN, f32::max);
    assert!(furthest > lips + 0.008, "the tip is {} m ahead of the lips", furthest - lips);
    let inside = out.vertices.iter().zip(&out.positions).filter(|(_, by)| by[2] > 0.02);
    assert!(
        inside.map(|(&v, _)| mesh.positions[v as usize][2]).fold(f32::MIN, f32::max) < lips,
        "and behind them at rest"
    );
}

#[test]
fn the_jaw_slides_with_teeth_and_lower_lip() {
    let mesh = &FIGURES[0];
    for (name, axis, sign) in [("jawLeft", 0, 1.0), ("jawRight", 0, -1.0), ("jawForward", 2, 1.0)] {
        let moved = &morph(mesh, name).positions;
        let most = moved.iter().map(|by| by[axis] * sign).fold(0.0, f32::max);
        assert!((0.004..0.02).contains(&most), "{name}: {most}");
        assert!(moved.iter().all(|by| by[axis] * sign >= 0.0), "{name} goes one way");
    }
}
