//! Reader of `.glb` files written by `umo`: the 55 joints by name, one animation, named morph weights; of one character,
//! or of the members of a conversation.

use std::collections::BTreeMap;

use umo_core::{JOINT_NAMES, JOINTS, Skeleton};
use umo_core_pose::clip::Clip;
use umo_core_pose::rotation::{IDENTITY, normalized, slerp};

use super::{MAX_FRAMES, Member};
use umo_core_rig::glb::Glb;
use umo_core_rig::glb::accessor::floats;
use umo_core_rig::glb::document::{Animation, Document, Node, Sampler};

/// Most frames between the nearest keys of a file with few.
const MOST_FRAMES_APART: u32 = 10;

pub(super) fn read(bytes: &[u8]) -> Result<Vec<Member>, String> {
    let file = Glb::split(bytes)?;
    let document = Document::parse(file.json)?;
    let parents = document.parents()?;
    let first = clip(&document, &parents, file.bin, "")?;
    let others = others(&document, &parents);
    if others.is_empty() {
        return Ok(vec![Member::alone(first)]);
    }
    let hips = super::joints(document.nodes.iter().map(|node| node.name.as_deref()))?[0];
    let place = parents[hips].ok_or("its first member has no place")?;
    let mut members = vec![member(&document.nodes[place], first)];
    for place in others {
        let node = &document.nodes[place];
        let prefix = format!("{}-", node.name.as_deref().unwrap_or_default());
        members.push(member(node, clip(&document, &parents, file.bin, &prefix)?));
    }
    Ok(members)
}

/// Returns the nodes of the places of all members but the first: `bob` above `bob-pelvis`.
fn others(document: &Document, parents: &[Option<usize>]) -> Vec<usize> {
    let above = |(place, node): (usize, &Node)| {
        let parent = parents[place]?;
        let name = document.nodes[parent].name.as_deref()?;
        let own = node.name.as_deref()?.strip_prefix(name)?.strip_prefix('-')?;
        (own == JOINT_NAMES[0]).then_some(parent)
    };
    document.nodes.iter().enumerate().filter_map(above).collect()
}

#[expect(clippy::cast_possible_truncation, reason = "rounding to f32 is intended")]
fn member(place: &Node, clip: Clip) -> Member {
    let [_, y, _, w] = place.rotation.unwrap_or([0.0, 0.0, 0.0, 1.0]);
    Member {
        name: place.name.clone().unwrap_or_default(),
        position: place.translation.unwrap_or([0.0; 3]).map(|x| x as f32),
        facing: (2.0 * y.atan2(w)) as f32,
        figure: place.extras.get("figure").and_then(|name| name.as_str()?.parse().ok()),
        clip,
    }
}

/// Returns the motion of the character whose names have this prefix.
fn clip(document: &Document, parents: &[Option<usize>], bin: &[u8], prefix: &str) -> Result<Clip, String> {
    let names = document.nodes.iter().map(|node| node.name.as_deref()?.strip_prefix(prefix));
    let places = super::joints(names)?;
    let skeleton = skeleton(document, parents, &places)?;
    let tracks = Tracks::of(document, bin)?;
    let frames = tracks.times.len();
    let root = skeleton.offsets_m[0];
    let line = |a: [f32; 3], b: [f32; 3], share: f32| std::array::from_fn(|i| a[i] + share * (b[i] - a[i]));
    let translation = match tracks.values(document, places[0], "translation", line)? {
        Some(places) => places.as_chunks().0.iter().map(|&at| less(at, root)).collect(),
        None => vec![[0.0; 3]; frames],
    };
    let mut rotations = vec![[IDENTITY; JOINTS]; frames];
    for (joint, &place) in places.iter().enumerate() {
        let Some(values) = tracks.values(document, place, "rotation", slerp)? else { continue };
        for (frame, &q) in rotations.iter_mut().zip(values.as_chunks().0) {
            frame[joint] = normalized(q);
        }
    }
    let (names, face_values) = face(document, &tracks, prefix)?;
    let face = super::face(names);
    Ok(Clip { frame_rate: tracks.rate()?, skeleton, face, rotations, translation, face_values })
}

#[expect(clippy::cast_possible_truncation, reason = "rounding to f32 is intended; the result is checked")]
fn skeleton(document: &Document, parents: &[Option<usize>], places: &[usize; JOINTS]) -> Result<Skeleton, String> {
    let parents = super::parents(places, parents)?;
    let mut offsets_m = Vec::with_capacity(JOINTS);
    for node in places.map(|place| &document.nodes[place]) {
        let turned = node.rotation.is_some_and(|[x, y, z, _]| [x, y, z] != [0.0; 3]);
        if node.matrix.is_some() || turned || node.scale.is_some_and(|scale| scale != [1.0; 3]) {
            return Err("not an animation that umo wrote: a joint is turned or scaled at rest".to_owned());
        }
        offsets_m.push(node.translation.unwrap_or([0.0; 3]).map(|x| x as f32));
    }
    Ok(Skeleton { parents, offsets_m })
}

/// Returns names and values `[frames, names]` of the first animated mesh with named shapes, or that of the prefix.
fn face(document: &Document, tracks: &Tracks<'_>, prefix: &str) -> Result<(Vec<String>, Vec<f32>), String> {
    let named = |node: &Node| node.name.as_deref().and_then(|name| name.strip_prefix(prefix)) == Some("face");
    let is_own = |node: &Node| prefix.is_empty() || named(node);
    for (place, node) in document.nodes.iter().enumerate().filter(|(_, node)| is_own(node)) {
        let Some(names) = node.mesh.and_then(|mesh| document.meshes.get(mesh)?.shape_names()) else { continue };
        let Some(sampler) = tracks.sampler(place, "weights") else { continue };
        let values = floats(document, tracks.bin, sampler.output, "SCALAR")?;
        let values = tracks.on_frames(sampler, values, names.len(), |a, b, share, out| {
            out.extend(a.iter().zip(b).map(|(a, b)| a + share * (b - a)));
        });
        return Ok((names, values.ok_or("its morph weights are not frames times shapes")?));
    }
    Ok((Vec::new(), Vec::new()))
}

/// The file's first animation.
struct Tracks<'a> {
    animation: &'a Animation,
    bin: &'a [u8],
    /// Times of each sampler's keys, by its input.
    keys: BTreeMap<usize, Vec<f32>>,
    /// Frame times, seconds.
    times: Vec<f32>,
}

impl<'a> Tracks<'a> {
    fn of(document: &'a Document, bin: &'a [u8]) -> Result<Self, String> {
        let animation = document.animations.first().ok_or("it has no animation")?;
        if animation.samplers.iter().any(|s| s.interpolation.as_deref().is_some_and(|kind| kind == "CUBICSPLINE")) {
            return Err("its tracks are splines".to_owned());
        }
        let mut keys = BTreeMap::new();
        for sampler in &animation.samplers {
            let times = floats(document, bin, sampler.input, "SCALAR")?;
            match times.len() {
                0 => return Err("it has no frames".to_owned()),
                1..=MAX_FRAMES => keys.insert(sampler.input, times),
                frames => return Err(format!("{frames} frames are too many")),
            };
        }
        let first = animation.samplers.first().ok_or("its animation is empty")?;
        let times = if keys.len() == 1 { keys[&first.input].clone() } else { frames(&keys)? };
        Ok(Self { animation, bin, keys, times })
    }

    /// Returns frames per second.
    fn rate(&self) -> Result<f32, String> {
        let (first, last, steps) = (self.times[0], self.times[self.times.len() - 1], self.times.len() - 1);
        if steps == 0 {
            return Ok(30.0);
        }
        let step = f64::from(last - first) / steps as f64;
        let even = |(i, &time): (usize, &f32)| (f64::from(time - first) - i as f64 * step).abs() < 0.02 * step + 1e-4;
        if !(step > 0.0 && self.times.iter().enumerate().all(even)) {
            return Err("its frames are not evenly apart".to_owned());
        }
        let rate = 1.0 / step;
        #[expect(clippy::cast_possible_truncation, reason = "rates are kept in f32")]
        Ok(if (rate - rate.round()).abs() < 1e-3 { rate.round() as f32 } else { rate as f32 })
    }

    /// Returns the sampler of a node's values.
    fn sampler(&self, node: usize, path: &str) -> Option<&'a Sampler> {
        let mut channels = self.animation.channels.iter();
        let channel = channels.find(|channel| channel.target.node == Some(node) && channel.target.path == path)?;
        self.animation.samplers.get(channel.sampler)
    }

    /// Returns a value of `width` numbers for every frame, of one for every key; `None` if there are more or fewer.
    fn on_frames(
        &self,
        sampler: &Sampler,
        values: Vec<f32>,
        width: usize,
        between: impl Fn(&[f32], &[f32], f32, &mut Vec<f32>),
    ) -> Option<Vec<f32>> {
        let keys = self.keys.get(&sampler.input).filter(|keys| values.len() == width * keys.len())?;
        if keys.len() == self.times.len() {
            return Some(values);
        }
        let (key, mut all, mut next) = (|at: usize| &values[width * at..][..width], Vec::new(), 0);
        for &time in &self.times {
            while next + 1 < keys.len() && keys[next] < time {
                next += 1;
            }
            let before = next.saturating_sub(1);
            let length = keys[next] - keys[before];
            let share = if length > 0.0 { ((time - keys[before]) / length).clamp(0.0, 1.0) } else { 0.0 };
            between(key(before), key(next), share, &mut all);
        }
        Some(all)
    }

    /// Returns a node's values, one per frame.
    fn values<const N: usize>(
        &self,
        document: &Document,
        node: usize,
        path: &str,
        between: impl Fn([f32; N], [f32; N], f32) -> [f32; N],
    ) -> Result<Option<Vec<f32>>, String> {
        let Some(sampler) = self.sampler(node, path) else { return Ok(None) };
        let values = floats(document, self.bin, sampler.output, if N == 3 { "VEC3" } else { "VEC4" })?;
        let array = |values: &[f32]| std::array::from_fn(|i| values[i]);
        let values =
            self.on_frames(sampler, values, N, |a, b, share, out| out.extend(between(array(a), array(b), share)));
        values.map(Some).ok_or_else(|| format!("the {path} of node {node}: not one value per key"))
    }
}

/// Returns the times of the frames that the keys of all tracks are on.
fn frames(keys: &BTreeMap<usize, Vec<f32>>) -> Result<Vec<f32>, String> {
    let wrong = || "its tracks have different times".to_owned();
    let (mut ends, mut gap) = (None, f64::INFINITY);
    for times in keys.values() {
        let own = (times[0], times[times.len() - 1]);
        if *ends.get_or_insert(own) != own {
            return Err(wrong());
        }
        gap = times.windows(2).map(|pair| f64::from(pair[1] - pair[0])).fold(gap, f64::min);
    }
    let (first, last) = ends.ok_or_else(wrong)?;
    if !(gap > 0.0 && gap.is_finite()) {
        return Err(wrong());
    }
    let length = f64::from(last - first);
    // Rates are whole numbers, or nearly so.
    let rates = (1..=MOST_FRAMES_APART)
        .map(f64::from)
        .flat_map(|frames| [(frames / gap).round(), (length * frames / gap).round() / length]);
    let is_frame = |rate: f64| {
        move |time: &f32| {
            let frame = f64::from(time - first) * rate;
            (frame - frame.round()).abs() < 0.05
        }
    };
    for rate in rates {
        let steps = (length * rate).round();
        if steps > MAX_FRAMES as f64 {
            return Err(format!("{steps} frames are too many"));
        }
        if rate > 0.0 && keys.values().flatten().all(is_frame(rate)) {
            #[expect(
                clippy::cast_possible_truncation,
                clippy::cast_sign_loss,
                reason = "checked above; rounding to f32"
            )]
            return Ok((0..=steps as usize)
                .map(|frame| (f64::from(first) + frame as f64 * length / steps) as f32)
                .collect());
        }
    }
    Err(wrong())
}

fn less([a, b, c]: [f32; 3], [x, y, z]: [f32; 3]) -> [f32; 3] {
    [a - x, b - y, c - z]
}
