//! Parser of `.bvh` text: a hierarchy of joints and their channels over time.

use std::iter::Peekable;
use std::str::SplitWhitespace;

/// Upper bound on the joints of a file, far above any body's count.
const MAX_JOINTS: usize = 4096;
/// Number of frames compared with the offsets.
const MAX_COMPARED: usize = 100;
/// Upper bound on the depth of the hierarchy.
const MAX_DEPTH: usize = 256;

/// Meaning of one number of a frame: translation or rotation, with its axis; 0 is X.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Channel {
    /// Position, in the file's unit.
    Position(usize),
    /// Rotation, degrees.
    Rotation(usize),
}

/// A joint.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Joint {
    pub(crate) name: String,
    /// `None` for the root.
    pub(crate) parent: Option<usize>,
    /// Offset from the parent, in the file's unit.
    pub(crate) offset: [f32; 3],
    /// Channels in the order of a frame's numbers; the first rotation is the outermost.
    pub(crate) channels: Vec<Channel>,
    /// End of the bone, for a joint without children.
    pub(crate) end: Option<[f32; 3]>,
}

/// A parsed file.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Bvh {
    /// Joints in the order of a frame's numbers, parents first.
    pub(crate) joints: Vec<Joint>,
    /// Seconds from one frame to the next.
    pub(crate) frame_time: f64,
    /// `[frames, channels]`
    pub(crate) motion: Vec<f64>,
    /// Length of the text before its motion, bytes.
    pub(crate) hierarchy: usize,
}

impl Bvh {
    /// Reads a file's text.
    ///
    /// # Errors
    /// A description of the first violation of the format.
    pub(crate) fn parse(text: &str) -> Result<Self, String> {
        let marked = text.strip_prefix('\u{feff}').unwrap_or(text);
        let mut words = Words(marked.split_whitespace().peekable());
        words.expect("HIERARCHY")?;
        // The markers of `umo animate --reduce`.
        if words.0.peek().is_some_and(|word| word.starts_with('#')) {
            let below = marked.trim_start().split_once('\n').map_or("", |(_, below)| below);
            words = Words(below.split_whitespace().peekable());
        }
        words.expect("ROOT")?;
        let joints = hierarchy(&mut words)?;
        let rest = words.0.peek().map_or(text.len(), |word| word.as_ptr() as usize - text.as_ptr() as usize);
        words.expect("MOTION")?;
        words.expect("Frames:")?;
        let frames: usize = words.number("the number of frames")?;
        words.expect("Frame")?;
        words.expect("Time:")?;
        let frame_time: f64 = words.number("the time of a frame")?;
        if !(frame_time > 0.0 && frame_time.is_finite()) {
            return Err(format!("frame time {frame_time}: expected more than 0 seconds"));
        }
        let mut motion = Vec::new();
        while words.0.peek().is_some() {
            motion.push(words.finite("a channel")?);
        }
        let bvh = Self { joints, frame_time, motion, hierarchy: rest };
        let wanted = bvh.channels().checked_mul(frames);
        if wanted != Some(bvh.motion.len()) {
            let (got, each) = (bvh.motion.len(), bvh.channels());
            return Err(format!("{frames} frames of {each} channels were announced, {got} numbers are there"));
        }
        Ok(bvh)
    }

    /// Returns for each joint whether its position channels replace its offset, as Blender and others write them,
    /// instead of adding to it. They replace it if the frames' positions are nearer to the offsets than to 0. The root
    /// is decided separately from all other joints. Without frames, the other joints' positions replace their offsets.
    pub(crate) fn replaces(&self) -> Vec<bool> {
        let mut apart = [[0.0; 2]; 2];
        for frame in self.motion.chunks_exact(self.channels().max(1)).take(MAX_COMPARED) {
            let mut values = frame.iter();
            for joint in &self.joints {
                let sums = &mut apart[usize::from(joint.parent.is_some())];
                for (channel, value) in joint.channels.iter().zip(values.by_ref()) {
                    if let Channel::Position(axis) = channel {
                        sums[0] += (value - f64::from(joint.offset[*axis])).abs();
                        sums[1] += value.abs();
                    }
                }
            }
        }
        let [root, others] = apart.map(|[replaced, added]| replaced < added);
        let others = others || self.motion.is_empty();
        self.joints.iter().map(|joint| if joint.parent.is_none() { root } else { others }).collect()
    }

    /// Returns the number of channels per frame.
    pub(crate) fn channels(&self) -> usize {
        self.joints.iter().map(|joint| joint.channels.len()).sum()
    }
}

/// Parses all joints, from the root's name to its closing brace.
fn hierarchy(words: &mut Words<'_>) -> Result<Vec<Joint>, String> {
    let mut joints = vec![joint(words, None)?];
    // Joints whose braces are open.
    let mut open = vec![0];
    while let Some(&inside) = open.last() {
        match words.next()? {
            word if word.eq_ignore_ascii_case("JOINT") => {
                if joints.len() == MAX_JOINTS || open.len() == MAX_DEPTH {
                    return Err(format!("more than {MAX_JOINTS} joints, or more than {MAX_DEPTH} in a chain"));
                }
                open.push(joints.len());
                joints.push(joint(words, Some(inside))?);
            }
            word if word.eq_ignore_ascii_case("End") => {
                words.expect("Site")?;
                words.expect("{")?;
                joints[inside].end = Some(offset(words)?);
                words.expect("}")?;
            }
            "}" => {
                open.pop();
            }
            word => return Err(format!("expected `JOINT`, `End` or `}}`, got `{word}`")),
        }
    }
    Ok(joints)
}

/// Parses a joint's name, offset and channels.
fn joint(words: &mut Words<'_>, parent: Option<usize>) -> Result<Joint, String> {
    let name = words.name()?;
    let offset = offset(words)?;
    words.expect("CHANNELS")?;
    let count: usize = words.number("the number of channels")?;
    if count > 6 {
        return Err(format!("joint `{name}`: {count} channels, there are only 6"));
    }
    let channels = (0..count).map(|_| channel(words)).collect::<Result<Vec<_>, _>>()?;
    if (1..count).any(|i| channels[..i].contains(&channels[i])) {
        return Err(format!("joint `{name}`: a channel is listed twice"));
    }
    Ok(Joint { name, parent, offset, channels, end: None })
}

fn channel(words: &mut Words<'_>) -> Result<Channel, String> {
    let word = words.next()?;
    let unknown = || format!("unknown channel `{word}`");
    let (axis, kind) = word.split_at_checked(1).ok_or_else(unknown)?;
    let axis = ["X", "Y", "Z"].iter().position(|a| a.eq_ignore_ascii_case(axis)).ok_or_else(unknown)?;
    match kind.to_ascii_lowercase().as_str() {
        "position" => Ok(Channel::Position(axis)),
        "rotation" => Ok(Channel::Rotation(axis)),
        _ => Err(unknown()),
    }
}

fn offset(words: &mut Words<'_>) -> Result<[f32; 3], String> {
    words.expect("OFFSET")?;
    let mut offset = [0.0; 3];
    for value in &mut offset {
        *value = words.finite("an offset")?;
    }
    #[expect(clippy::cast_possible_truncation, reason = "bones are kept in f32; what overflows is refused below")]
    let offset = offset.map(|x| x as f32);
    match offset.iter().all(|x| x.is_finite()) {
        true => Ok(offset),
        false => Err("an offset is too large".to_owned()),
    }
}

/// Iterator over a file's words.
struct Words<'a>(Peekable<SplitWhitespace<'a>>);

impl<'a> Words<'a> {
    fn next(&mut self) -> Result<&'a str, String> {
        self.0.next().ok_or_else(|| "the file ends too early".to_owned())
    }

    fn expect(&mut self, want: &str) -> Result<(), String> {
        let word = self.next()?;
        match word.eq_ignore_ascii_case(want) {
            true => Ok(()),
            false => Err(format!("expected `{want}`, got `{word}`")),
        }
    }

    fn number<T: std::str::FromStr>(&mut self, what: &str) -> Result<T, String> {
        let word = self.next()?;
        word.parse().map_err(|_| format!("{what}: expected a number, got `{word}`"))
    }

    fn finite(&mut self, what: &str) -> Result<f64, String> {
        let value: f64 = self.number(what)?;
        match value.is_finite() {
            true => Ok(value),
            false => Err(format!("{what} is {value}")),
        }
    }

    /// Parses a name, which may contain spaces, and the brace after it.
    fn name(&mut self) -> Result<String, String> {
        let mut name = self.next()?.to_owned();
        loop {
            match self.next()? {
                "{" => return Ok(name),
                word if name.len() + word.len() < 256 => {
                    name.push(' ');
                    name.push_str(word);
                }
                _ => return Err(format!("expected `{{` after the name `{}`…", &name[..name.floor_char_boundary(32)])),
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const TWO: &str = "HIERARCHY\nROOT the hips\n{\nOFFSET 0 1 2\nCHANNELS 6 Xposition Yposition Zposition Zrotation \
        Xrotation Yrotation\nJOINT knee {\n OFFSET 0 -1e1 0 CHANNELS 1 Xrotation End Site { OFFSET 0 0 5 } } }\n\
        MOTION\nFrames: 2\nFrame Time: 0.04\n1 2 3 4 5 6 7\n-1 -2 -3 -4 -5 -6 -7\n";

    #[test]
    fn a_file_is_read_as_the_format_has_it() {
        let bvh = Bvh::parse(TWO).unwrap();
        assert_eq!((bvh.channels(), bvh.motion.len(), bvh.frame_time), (7, 14, 0.04));
        assert_eq!((bvh.joints[0].name.as_str(), bvh.joints[0].offset), ("the hips", [0.0, 1.0, 2.0]));
        assert_eq!(bvh.joints[0].channels[3..], [Channel::Rotation(2), Channel::Rotation(0), Channel::Rotation(1)]);
        let knee = &bvh.joints[1];
        assert_eq!((knee.parent, knee.offset, knee.end), (Some(0), [0.0, -10.0, 0.0], Some([0.0, 0.0, 5.0])));
        assert_eq!(bvh.motion[7..9], [-1.0, -2.0]);
        assert!(TWO[bvh.hierarchy..].starts_with("MOTION"));
    }

    #[test]
    fn keywords_of_any_case_and_a_byte_order_mark_are_read() {
        let plain = Bvh::parse(TWO).unwrap();
        for text in [TWO.to_lowercase(), TWO.to_uppercase()] {
            let read = Bvh::parse(&text).unwrap();
            assert_eq!((read.motion, read.joints.len()), (plain.motion.clone(), 2));
        }
        let marked = format!("\u{feff}{TWO}");
        let read = Bvh::parse(&marked).unwrap();
        assert!(read.joints == plain.joints && marked[read.hierarchy..].starts_with("MOTION"));
    }

    #[test]
    fn places_that_repeat_their_offsets_stand_in_their_place() {
        let file = |root: &str, knee: &str| {
            let text = format!(
                "HIERARCHY ROOT hips {{ OFFSET 0 95 0 CHANNELS 3 Xposition Yposition Zposition \
                 JOINT spine {{ OFFSET 0 10 0 CHANNELS 3 Xposition Yposition Zposition \
                 JOINT knee {{ OFFSET 1 -40 0 CHANNELS 3 Xposition Yposition Zposition \
                 End Site {{ OFFSET 0 0 5 }} }} }} }} MOTION Frames: 1 Frame Time: 0.1 {root} 0 0 0 {knee}"
            );
            Bvh::parse(&text).unwrap().replaces()
        };
        assert_eq!(file("0 95 0", "0 0 0"), [true, false, false]);
        assert_eq!(file("300 91 -200", "0 0 0"), [true, false, false]);
        assert_eq!(file("300 -4 -200", "0 0 0"), [false, false, false]);
        // From a motion capture performer, offset by some hundredths.
        assert_eq!(file("0 0 0", "1.02 -40.8 0.01"), [false, true, true]);
    }

    #[test]
    fn errors_name_the_defect() {
        let broken = |from: &str, to: &str| {
            assert!(TWO.contains(from));
            Bvh::parse(&TWO.replace(from, to)).unwrap_err()
        };
        assert!(broken("-7", "").contains("13 numbers"));
        assert!(broken("-7", "-7 8").contains("15 numbers"));
        assert!(broken("Frames: 2", "Frames: 18446744073709551615").contains("announced"));
        assert!(broken("-7", "NaN").contains("NaN"));
        assert!(broken("-1e1", "1e39").contains("too large"));
        assert!(broken("0.04", "0").contains("more than 0"));
        assert!(broken("Yrotation", "Xrotation").contains("twice"));
        assert!(broken("Yrotation", "Wrotation").contains("unknown channel"));
        assert!(broken("CHANNELS 1", "CHANNELS 7").contains("only 6"));
        assert!(broken("End Site", "End Seat").contains("`Seat`"));
        assert!(broken("MOTION", "").contains("MOTION"));
        assert!(Bvh::parse("").unwrap_err().contains("too early"));
        let deep = format!(
            "HIERARCHY ROOT a {{ OFFSET 0 0 0 CHANNELS 0 {}",
            "JOINT b { OFFSET 0 0 0 CHANNELS 0 ".repeat(9999)
        );
        assert!(Bvh::parse(&deep).unwrap_err().contains("in a chain"));
    }

    #[test]
    fn a_file_that_is_cut_anywhere_is_refused() {
        for end in 0..TWO.len() - 3 {
            Bvh::parse(&TWO[..end]).unwrap_err();
        }
    }
}
