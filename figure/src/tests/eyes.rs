use super::*;

/// Vertices of the skin that blinking moves, ending with the ring nearest to the opening.
fn lids(mesh: &Mesh, side: &str) -> (V, Vec<usize>) {
    let skeleton = sample::skeleton();
    let eye = Rest::new(&skeleton).unwrap().side(&side.to_lowercase(), "eye");
    let moved = &morph(mesh, &format!("eyeBlink{side}")).vertices;
    (eye, moved.iter().map(|&v| v as usize).collect())
}

/// Radius of the eyeball: the largest distance of a vertex on the eye's joint.
fn eyeball(mesh: &Mesh, side: &str, centre: V) -> f32 {
    let joint = skin::number(&format!("{}_eye", side.to_lowercase()));
    let on = |v: &usize| mesh.joints[*v][0] == joint;
    (0..mesh.positions.len()).filter(on).map(|v| distance(mesh.positions[v], centre)).fold(0.0, f32::max) - 0.0004
}

/// Opening of the lids in degrees: the largest vertical angle at the eye's centre between neighbours along the middle
/// that lie next to the eyeball's front.
fn opening(mesh: &Mesh, places: &[V], side: &str) -> f32 {
    let (centre, moved) = lids(mesh, side);
    let radius = eyeball(mesh, side, centre);
    // The lids' edges are nearest to the eyeball.
    let edge = moved.iter().filter(|&&v| (distance(mesh.positions[v], centre) - radius) < 0.0019 * 1.1);
    let mut rises: Vec<f32> = edge
        .map(|&v| sub(places[v], centre))
        .filter(|from| from[0].abs() < 0.0025 && from[2] > 0.0)
        .map(|from| from[1].atan2(from[2]).to_degrees())
        .collect();
    rises.sort_by(f32::total_cmp);
    rises.windows(2).map(|pair| pair[1] - pair[0]).fold(0.0, f32::max)
}

#[test]
fn a_blink_closes_the_lids_over_the_eyeball() {
    let mesh = &FIGURES[0];
    for side in ["Left", "Right"] {
        let name = format!("eyeBlink{side}");
        let open = opening(mesh, &mesh.positions, side);
        assert!(open > 25.0, "the open eye is open: {open} degrees");
        let shut = shaped(mesh, &[&name]);
        let (centre, moved) = lids(mesh, side);
        let radius = eyeball(mesh, side, centre);
        // The margins, between the lids' wet edge and their outside.
        let gap = |v: usize| distance(mesh.positions[v], centre) - radius;
        let margin: Vec<usize> = moved.iter().copied().filter(|&v| (0.0012..0.0020).contains(&gap(v))).collect();
        let upper = |v: usize| mesh.positions[v][1] > centre[1] + 0.002;
        let lower = |v: usize| mesh.positions[v][1] < centre[1] - 0.002;
        // The upper lid's edge moves furthest; skin near the eyeball moves less.
        let way = |v: usize| distance(mesh.positions[v], shut[v]);
        let furthest = margin.iter().filter(|&&v| upper(v)).map(|&v| way(v)).fold(0.0, f32::max);
        let mut met = 0;
        for &v in margin.iter().filter(|&&v| upper(v) && way(v) > 0.62 * furthest) {
            let nearest = margin.iter().filter(|&&w| lower(w)).map(|&w| distance(shut[v], shut[w])).fold(1.0, f32::min);
            if (mesh.positions[v][0] - centre[0]).abs() < 0.009 {
                assert!(nearest < 0.001, "the lids are {nearest} m apart");
                met += 1;
            }
        }
        assert!(met > 5, "only {met} places of the upper lid's edge were found");
    }
}

#[test]
fn lids_stay_outside_the_eyeball() {
    let mesh = &FIGURES[0];
    for side in ["Left", "Right"] {
        let (centre, moved) = lids(mesh, side);
        let radius = eyeball(mesh, side, centre);
        for shape in ["eyeBlink", "eyeLookDown", "eyeLookUp", "eyeLookIn", "eyeLookOut", "eyeSquint", "eyeWide"] {
            let places = shaped(mesh, &[&format!("{shape}{side}")]);
            for &v in &moved {
                let over = distance(places[v], centre) - radius;
                assert!(over > 0.0, "{shape}{side}: a lid is {over} m over the eyeball");
            }
        }
    }
}

#[test]
fn eyes_open_wide_squint_and_follow_the_gaze() {
    let mesh = &FIGURES[0];
    let open = opening(mesh, &mesh.positions, "Left");
    let with = |name: &str| opening(mesh, &shaped(mesh, &[name]), "Left");
    assert!(with("eyeWideLeft") > open + 5.0);
    assert!(with("eyeSquintLeft") < open - 5.0);
    let upper = |name: &str| -> f32 { morph(mesh, name).positions.iter().map(|by| by[1]).sum() };
    assert!(upper("eyeLookDownLeft") < 0.0 && upper("eyeLookUpLeft") > 0.0);
    let aside = |name: &str| -> f32 { morph(mesh, name).positions.iter().map(|by| by[0]).sum() };
    assert!(aside("eyeLookInLeft") < 0.0 && aside("eyeLookOutLeft") > 0.0, "the left eye looks out to +X");
}

#[test]
fn eyeballs_turn_with_their_joints_and_with_no_shape() {
    let mesh = &FIGURES[0];
    let joints = ["left_eye", "right_eye"].map(skin::number);
    let ball: HashSet<u32> = (0..u32::try_from(mesh.joints.len()).unwrap())
        .filter(|&v| joints.contains(&mesh.joints[v as usize][0]))
        .collect();
    assert!(ball.len() > 400);
    for morph in &mesh.morphs {
        assert!(morph.vertices.iter().all(|v| !ball.contains(v)), "{} moves an eyeball", morph.name);
    }
    assert!(ball.iter().all(|&v| mesh.weights[v as usize][0] == 1.0));
}
