//! Bone names: normalisation, and the tables of naming conventions.

use super::Rig;

mod conventions;

pub(super) use conventions::CONVENTIONS;

/// Side of the body, from the character's point of view.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) enum Side {
    #[default]
    Middle,
    Left,
    Right,
}

/// A normalised name: side, prefix, case and separators removed.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(super) struct Key {
    side: Side,
    text: String,
    /// Whether the name has a prefix that marks deforming bones.
    deforms: bool,
}

/// Names of one vendor or program. Each field lists alternatives, separated by spaces, in order of preference. For
/// `spine` and `neck`, all bones that are found make a chain.
#[derive(Debug)]
pub(super) struct Convention {
    pub(super) name: &'static str,
    pub(super) hips: &'static str,
    pub(super) spine: &'static str,
    pub(super) neck: &'static str,
    pub(super) head: &'static str,
    pub(super) jaw: &'static str,
    pub(super) eye: &'static str,
    /// Collar, upper arm, forearm, hand.
    pub(super) arm: [&'static str; 4],
    /// Thigh, shin, foot, toes.
    pub(super) leg: [&'static str; 4],
    /// Index, middle, little, ring, thumb, from the palm out.
    pub(super) fingers: [[&'static str; 3]; 5],
}

impl Convention {
    /// The joints that have a single bone, with their names.
    pub(super) fn joints(&self) -> impl Iterator<Item = (usize, Side, &'static str)> {
        const ARM: [[usize; 4]; 2] = [[13, 16, 18, 20], [14, 17, 19, 21]];
        const LEG: [[usize; 4]; 2] = [[1, 4, 7, 10], [2, 5, 8, 11]];
        let middle = [(0, Side::Middle, self.hips), (15, Side::Middle, self.head), (22, Side::Middle, self.jaw)];
        let (arm, leg, eye, fingers) = (self.arm, self.leg, self.eye, self.fingers);
        let sided = [Side::Left, Side::Right].into_iter().enumerate().flat_map(move |(at, side)| {
            let limbs = ARM[at].into_iter().zip(arm).chain(LEG[at].into_iter().zip(leg));
            let fingers = (25 + 15 * at..).zip(fingers.into_iter().flatten());
            limbs.chain([(23 + at, eye)]).chain(fingers).map(move |(joint, names)| (joint, side, names))
        });
        middle.into_iter().chain(sided)
    }
}

/// Returns the key of each bone, without the decoration that an exporter added to most names.
pub(super) fn keys(rig: &Rig) -> Vec<Key> {
    let decoration = Decoration::of(rig);
    rig.bones().iter().map(|bone| decoration.key(&bone.name)).collect()
}

/// Returns a bone's name as it is matched, if an exporter added a decoration to most names that no convention uses.
pub(super) fn undecorated(rig: &Rig, bone: usize) -> Option<String> {
    let decoration = Decoration::of(rig);
    let Key { side, text, .. } = decoration.key(&rig.bones()[bone].name);
    let side = match side {
        Side::Middle => "",
        Side::Left => "left ",
        Side::Right => "right ",
    };
    (decoration != Decoration::default()).then(|| format!("{side}{text}"))
}

/// The decoration that an exporter added to most names.
#[derive(Debug, Default, PartialEq, Eq)]
struct Decoration {
    /// A path prefix that belongs to no convention, such as `Armature|`.
    path: bool,
    /// Leading words.
    stem: Vec<String>,
    /// Number of trailing numbers, such as `.001` and `_03`.
    numbers: usize,
}

impl Decoration {
    /// Derived from the bones that a mesh follows, or from all if there are none.
    fn of(rig: &Rig) -> Self {
        let skinned = rig.bones().iter().any(|bone| bone.deforms);
        let bones = rig.bones().iter().filter(|bone| (bone.deforms || !skinned) && !bone.name.is_empty());
        let mut names: Vec<&str> = bones.map(|bone| bone.name.as_str()).collect();
        let is_most = |found: usize| found > 8 && 4 * found >= 3 * names.len();
        let is_foreign = |name: &&&str| {
            let (path, _) = split_path(name);
            // A known prefix is only dropped before another word.
            let mut words = words(&format!("{path} x"));
            drop_prefix(&mut words, &mut false);
            !path.is_empty() && (words.len() > 1 || path.starts_with("Armature"))
        };
        let path = is_most(names.iter().filter(is_foreign).count());
        let mut numbers = 0;
        while numbers < 2 && are_numbered(&names) {
            names.iter_mut().for_each(|name| *name = number(name).map_or(*name, |(bare, _)| bare));
            numbers += 1;
        }
        let mut all: Vec<Vec<String>> = names.iter().map(|name| bare_words(name, &mut false)).collect();
        let mut stem = Vec::new();
        while let Some(word) = shared(&all) {
            all.iter_mut().filter(|words| words.len() > 1 && words[0] == word).for_each(|words| drop(words.remove(0)));
            stem.push(word);
        }
        Self { path, stem, numbers }
    }

    fn key(&self, mut name: &str) -> Key {
        for _ in 0..self.numbers {
            name = number(name).map_or(name, |(bare, _)| bare);
        }
        key(name, &self.stem)
    }
}

/// The first word of most names, unless it is a side of the body.
fn shared(all: &[Vec<String>]) -> Option<String> {
    // A name and its number are not a stem and a name.
    let has_more = |words: &[String]| words.iter().skip(1).any(|word| !is_number(word));
    let count = |word: &String| all.iter().filter(|words| has_more(words) && words[0] == *word).count();
    let is_most = |word: &&String| {
        let found = count(word);
        found > 8 && 4 * found >= 3 * all.len()
    };
    // If three in four names share a word, one of the first `1 + n / 4` has it.
    let tried = all.iter().filter_map(|words| words.first()).take(1 + all.len() / 4);
    tried.filter(|word| side_of(word).is_none()).find(is_most).cloned()
}

/// Whether most names end in a number that a program appended: consecutive, as by Sketchfab (`mixamorig:Hips_01`,
/// `mixamorig:Spine_02`), or equal, as Blender does for copies (`Hips.001`).
fn are_numbered(names: &[&str]) -> bool {
    let mut numbers: Vec<u64> = names.iter().filter_map(|name| number(name)).map(|(_, number)| number).collect();
    let found = numbers.len();
    numbers.sort_unstable();
    let runs = numbers.chunk_by(|a, b| a == b);
    let (different, most) = runs.fold((0, 0), |(count, most), run| (count + 1, run.len().max(most)));
    // Numbers that are part of the names, as in `spine_01`, recur on other bones.
    found > 8 && 4 * found >= 3 * names.len() && (10 * different >= 9 * found || 10 * most >= 9 * found)
}

/// Splits a name into the part before a final number, after `_` or `.`, and the number.
fn number(name: &str) -> Option<(&str, u64)> {
    let (bare, number) = name.rsplit_once(['_', '.'])?;
    let digits = !number.is_empty() && is_number(number) && !bare.is_empty();
    digits.then(|| number.parse().ok()).flatten().map(|number| (bare, number))
}

/// Returns the bone of the first alternative that exists; of several bones with that name, one that a mesh follows.
pub(super) fn find(rig: &Rig, keys: &[Key], side: Side, alternatives: &str) -> Option<usize> {
    alternatives.split(' ').filter(|text| !text.is_empty()).find_map(|text| {
        let named = (0..keys.len()).filter(|&bone| keys[bone].side == side && keys[bone].text == text);
        named.min_by_key(|&bone| (!rig.bones()[bone].deforms, !keys[bone].deforms))
    })
}

/// Splits a name into its namespace or path, and the rest.
fn split_path(name: &str) -> (&str, &str) {
    name.rfind([':', '|', '/']).map_or(("", name), |at| (&name[..at], &name[at + 1..]))
}

/// Words of a name without its path and known prefixes.
fn bare_words(name: &str, deforms: &mut bool) -> Vec<String> {
    let mut words = words(&narrow(split_path(name).1));
    drop_prefix(&mut words, deforms);
    words
}

/// Normalises a name whose first words may be `stem`.
fn key(name: &str, stem: &[String]) -> Key {
    let mut deforms = false;
    let mut words = bare_words(name, &mut deforms);
    if words.len() > stem.len() && words.starts_with(stem) {
        words.drain(..stem.len());
        drop_prefix(&mut words, &mut deforms);
    }
    let mut side = Side::Middle;
    let sided = words.iter().position(|word| side_of(word).is_some());
    if let Some(at) = sided {
        side = side_of(&words.remove(at)).unwrap_or(side);
    } else if words.len() > 1 && words.last().is_some_and(|word| word == "m") {
        // `Root_M`: M stands for the middle.
        words.pop();
    } else if let Some((found, rest)) = words.first().and_then(|word| sided_word(word)) {
        (side, words[0]) = (found, rest);
    }
    Key { side, text: words.concat(), deforms }
}

/// Replaces full-width digits by ASCII ones.
fn narrow(name: &str) -> String {
    let digit = |letter: char| char::from_digit(u32::from(letter).wrapping_sub(u32::from('０')), 10);
    name.chars().map(|letter| digit(letter).unwrap_or(letter)).collect()
}

/// Words in lower case: split at separators, at capitals, and between letters and digits.
pub(super) fn words(name: &str) -> Vec<String> {
    let mut words = vec![String::new()];
    let mut before = ' ';
    let mut letters = name.chars().peekable();
    while let Some(letter) = letters.next() {
        let next_is_small = letters.peek().is_some_and(|next| next.is_lowercase());
        let starts = (letter.is_uppercase() && (!before.is_uppercase() || next_is_small))
            || letter.is_numeric() != before.is_numeric()
            || !before.is_alphanumeric();
        if starts && words.last().is_some_and(|word| !word.is_empty()) {
            words.push(String::new());
        }
        if let Some(word) = words.last_mut().filter(|_| letter.is_alphanumeric()) {
            word.extend(letter.to_lowercase());
        }
        before = letter;
    }
    words.retain(|word| !word.is_empty());
    words
}

/// Removes the prefixes that programs put before every name.
fn drop_prefix(words: &mut Vec<String>, deforms: &mut bool) {
    loop {
        let drop = match words.first().map(String::as_str) {
            Some("def") => {
                *deforms = true;
                1
            }
            // Includes the number of a copy: `mixamorig1`, `Bip001`.
            Some("mixamorig" | "bip" | "biped") => 1 + usize::from(words.get(1).is_some_and(|w| is_number(w))),
            Some("character") if words.get(1).is_some_and(|word| is_number(word)) => 2,
            Some("j" | "cc" | "base" | "armature" | "facial" | "valve") => 1,
            // `J_Bip_C_Hips`: C stands for the centre.
            Some("c") if words.len() > 1 => 1,
            _ => return,
        };
        // A name that consists only of a prefix is kept: it does not name a body part.
        if drop >= words.len() {
            return;
        }
        words.drain(..drop);
    }
}

fn is_number(word: &str) -> bool {
    word.bytes().all(|byte| byte.is_ascii_digit())
}

fn side_of(word: &str) -> Option<Side> {
    match word {
        "l" | "left" => Some(Side::Left),
        "r" | "right" => Some(Side::Right),
        _ => None,
    }
}

/// Splits a name that begins with a side, such as `leftarm` and `左腕`.
fn sided_word(word: &str) -> Option<(Side, String)> {
    let sides = [("left", Side::Left), ("right", Side::Right), ("左", Side::Left), ("右", Side::Right)];
    sides.into_iter().find_map(|(text, side)| Some((side, word.strip_prefix(text)?.to_owned())))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn cut(name: &str) -> (Side, String) {
        let key = key(name, &[]);
        (key.side, key.text)
    }

    #[test]
    fn names_lose_prefix_side_and_signs() {
        use Side::{Left, Middle, Right};
        for (name, side, text) in [
            ("mixamorig:LeftForeArm", Left, "forearm"),
            ("mixamorig1:RightHandIndex3", Right, "handindex3"),
            ("mixamorigSpine2", Middle, "spine2"),
            ("mixamorig12LeftArm", Left, "arm"),
            ("J_Bip_C_UpperChest", Middle, "upperchest"),
            ("J_Bip_L_UpperArm", Left, "upperarm"),
            ("upperarm_l", Left, "upperarm"),
            ("spine_03", Middle, "spine03"),
            ("lowerarm01.R", Right, "lowerarm01"),
            ("finger2-1.L", Left, "finger21"),
            ("DEF-f_index.01.L", Left, "findex01"),
            ("DEF-spine.006", Middle, "spine006"),
            ("Bip01 L Finger01", Left, "finger01"),
            ("Bip001 Spine1", Middle, "spine1"),
            ("Bip01", Middle, "bip01"),
            ("CC_Base_R_Upperarm", Right, "upperarm"),
            ("rShldrBend", Right, "shldrbend"),
            ("Left Little Proximal", Left, "littleproximal"),
            ("leftupperarm", Left, "upperarm"),
            ("|Root|Hips", Middle, "hips"),
            ("Root_M", Middle, "root"),
            ("IndexFinger1_L", Left, "indexfinger1"),
            ("ValveBiped.Bip01_R_UpperArm", Right, "upperarm"),
            ("Character1_LeftForeArm", Left, "forearm"),
            ("左人指１", Left, "人指1"),
            ("右足首", Right, "足首"),
            ("上半身2", Middle, "上半身2"),
            ("LHipJoint", Left, "hipjoint"),
            ("UpperArmL", Left, "upperarm"),
            ("Index1R", Right, "index1"),
            ("DEF-thumb01L", Left, "thumb01"),
            ("", Middle, ""),
            ("C", Middle, "c"),
        ] {
            assert_eq!(cut(name), (side, text.to_owned()), "{name}");
        }
    }

    #[test]
    fn numbers_that_a_program_put_after_every_name_are_dropped() {
        let rig = |name: &dyn Fn(usize) -> String| {
            Rig::new((0..12).map(|at| crate::retarget::Bone::new(name(at), None, [0.0; 3])).collect()).unwrap()
        };
        let texts = |rig: &Rig| keys(rig).into_iter().map(|key| key.text).collect::<Vec<_>>();
        assert_eq!(texts(&rig(&|at| format!("mixamorig:Spine{at}_{:03}", at + 5)))[11], "spine11");
        assert_eq!(texts(&rig(&|at| format!("spine_{:02}", at % 3)))[1], "spine01");
        assert_eq!(texts(&rig(&|at| if at == 0 { "a_1".to_owned() } else { format!("b{at}") }))[0], "a1");
    }

    #[test]
    fn what_exporters_put_on_every_name_is_dropped() {
        let plain = [
            "Hips",
            "Spine",
            "Spine1",
            "Neck",
            "Head",
            "LeftShoulder",
            "LeftArm",
            "LeftForeArm",
            "LeftHand",
            "RightArm",
            "RightForeArm",
            "RightHand",
            "LeftUpLeg",
            "LeftLeg",
            "LeftFoot",
            "RightUpLeg",
            "RightLeg",
            "RightFoot",
        ];
        let rig = |name: &dyn Fn(&str) -> String| {
            let mut names = vec!["Scene".to_owned(), "Body".to_owned()];
            names.extend(plain.iter().map(|plain| name(plain)));
            Rig::new(names.iter().map(|name| crate::retarget::Bone::new(name, None, [0.0; 3])).collect()).unwrap()
        };
        let wanted = keys(&rig(&|name| name.to_owned()));
        for (said, decorated) in [
            (false, "mixamorig:{}"),
            (false, "mixamorig{}"),
            (true, "mixamorig1:{}.001"),
            (true, "Armature|{}"),
            (true, "rig:{}"),
            (true, "Hero|Skeleton:{}"),
            (true, "Robot_{}"),
            (true, "Robot7{}"),
            (true, "My Robot.{}_03"),
            (true, "{}.001"),
            (true, "{}_03"),
            (true, "{}.001_03"),
            (true, "Armature|Robot-mixamorig1:{}.001"),
        ] {
            let rig = rig(&|name| decorated.replace("{}", name));
            let found = keys(&rig);
            assert_eq!(found[2..], wanted[2..], "{decorated}");
            assert_eq!(undecorated(&rig, 2).as_deref(), said.then_some("hips"), "{decorated}");
        }
        let rig = rig(&|name| format!("Armature|{name}.001"));
        assert_eq!(undecorated(&rig, 8).as_deref(), Some("left arm"));
        // Names that begin alike without a decoration.
        let fingers: Vec<_> =
            (1..=12).map(|at| crate::retarget::Bone::new(format!("L_Finger{at}"), None, [0.0; 3])).collect();
        assert_eq!(
            keys(&Rig::new(fingers).unwrap())[3],
            Key { side: Side::Left, text: "finger4".to_owned(), deforms: false }
        );
    }

    #[test]
    fn every_convention_names_all_55_joints_or_says_that_it_has_none() {
        for convention in &CONVENTIONS {
            let joints: Vec<_> = convention.joints().map(|(joint, ..)| joint).collect();
            assert_eq!(joints.len(), 51, "{}: all but three of the spine and the neck", convention.name);
            let mut sorted = joints.clone();
            sorted.sort_unstable();
            sorted.dedup();
            assert_eq!(sorted.len(), joints.len(), "{}", convention.name);
            let names = convention.joints().map(|(.., names)| names).chain([convention.spine, convention.neck]);
            for text in names.flat_map(|names| names.split(' ')).filter(|text| !text.is_empty()) {
                assert_eq!(words(text).concat(), text, "{}", convention.name);
            }
        }
    }
}
