//! `.bvh`: the skeleton's motion, in centimetres and degrees.

use super::{rotation, tip};
use std::io::{self, Write};
use umo_core::{JOINT_NAMES, JOINTS};
use umo_core_pose::clip::Clip;
use umo_gltf::keys::{Keying, Marker};

const CM: f64 = 100.0;

/// Writes hierarchy and motion. Rotation channels are Z, X, Y: a joint's matrix is `Z * X * Y`. The
/// root's position channels hold its whole position, so its offset is 0.
///
/// # Errors
/// Errors of `out`.
pub fn write<W: Write>(clip: &Clip, out: W) -> io::Result<()> {
    write_keyed(clip, None, out)
}

/// [`write()`], with the values that a motion of few keys has, and markers.
///
/// The format knows no comments. The end of its first line is the place that every importer tried leaves alone
/// (docs/formats.md).
///
/// # Errors
/// Errors of `out`.
pub fn write_keyed<W: Write>(clip: &Clip, keying: Option<&Keying>, mut out: W) -> io::Result<()> {
    let Some(Keying { bound, markers }) = keying else {
        writeln!(out, "HIERARCHY")?;
        return write_body(clip, out);
    };
    write!(out, "HIERARCHY #")?;
    for Marker { seconds, kind, name } in markers {
        write!(out, " {seconds:.3} {} {};", kind.name(), name.split_whitespace().collect::<Vec<_>>().join("_"))?;
    }
    writeln!(out)?;
    write_body(&bound.drawn(clip), out)
}

fn write_body<W: Write>(clip: &Clip, mut out: W) -> io::Result<()> {
    let mut order = Vec::with_capacity(JOINTS);
    write_joint(clip, 0, 0, &mut order, &mut out)?;
    writeln!(out, "MOTION")?;
    writeln!(out, "Frames: {}", clip.rotations.len())?;
    writeln!(out, "Frame Time: {:.9}", 1.0 / f64::from(clip.frame_rate))?;
    let mut before = [[0.0; 3]; JOINTS];
    for (frame, rotations) in clip.rotations.iter().enumerate() {
        let [x, y, z] = clip.root_position(frame).map(|x| f64::from(x) * CM);
        write!(out, "{x:.6} {y:.6} {z:.6}")?;
        for &joint in &order {
            let angles = rotation::euler_zxy(&rotation::matrix(rotations[joint]));
            let angles = continued(angles.map(f64::to_degrees), before[joint]);
            before[joint] = angles;
            let [z, x, y] = angles;
            write!(out, " {z:.6} {x:.6} {y:.6}")?;
        }
        writeln!(out)?;
    }
    Ok(())
}

/// Writes a joint and its descendants, and appends them to `order`, the order in which their motion is written.
fn write_joint<W: Write>(
    clip: &Clip,
    joint: usize,
    depth: usize,
    order: &mut Vec<usize>,
    out: &mut W,
) -> io::Result<()> {
    order.push(joint);
    let indent = "\t".repeat(depth);
    let (kind, offset, position) = if depth == 0 {
        let position = "6 Xposition Yposition Zposition";
        ("ROOT", [0.0; 3], position)
    } else {
        ("JOINT", clip.skeleton.offsets_m[joint], "3")
    };
    writeln!(out, "{indent}{kind} {}\n{indent}{{", JOINT_NAMES[joint])?;
    write_offset(&indent, offset, out)?;
    writeln!(out, "{indent}\tCHANNELS {position} Zrotation Xrotation Yrotation")?;
    let mut leaf = true;
    for child in clip.children(joint) {
        leaf = false;
        write_joint(clip, child, depth + 1, order, out)?;
    }
    if leaf {
        writeln!(out, "{indent}\tEnd Site\n{indent}\t{{")?;
        write_offset(&format!("{indent}\t"), tip(clip, joint), out)?;
        writeln!(out, "{indent}\t}}")?;
    }
    writeln!(out, "{indent}}}")
}

fn write_offset<W: Write>(indent: &str, offset: [f32; 3], out: &mut W) -> io::Result<()> {
    let [x, y, z] = offset.map(|x| f64::from(x) * CM);
    writeln!(out, "{indent}\tOFFSET {x:.6} {y:.6} {z:.6}")
}

/// Returns the angles of the same rotation that are nearest to the previous frame's. Programs interpolate
/// the numbers between frames, so a jump of a full turn would spin the joint.
pub(crate) fn continued(angles: [f64; 3], before: [f64; 3]) -> [f64; 3] {
    let [first, middle, last] = angles;
    let candidates = [angles, [first + 180.0, 180.0 - middle, last + 180.0]].map(|candidate| {
        let turns = |i: usize| ((before[i] - candidate[i]) / 360.0).round();
        std::array::from_fn(|i| candidate[i] + 360.0 * turns(i))
    });
    let distance = |c: &[f64; 3]| -> f64 { c.iter().zip(before).map(|(c, b)| (c - b).abs()).sum() };
    let [first, second] = candidates;
    // A threshold keeps rounding from changing the branch.
    if distance(&second) + 1e-6 < distance(&first) { second } else { first }
}
