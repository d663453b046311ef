//! What bones are called: names cut in words, and the tables of who calls them what.

use super::Rig;

mod conventions;

pub(super) use conventions::CONVENTIONS;

/// The side of the body, the character's own.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Side {
    Middle,
    Left,
    Right,
}

/// A name as conventions have it: without its side, its prefix, its case and what parts its words.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Key {
    side: Side,
    text: String,
    /// Marked as one that a mesh follows.
    deforms: bool,
}

/// Names of one maker or program. Each is one or more alternatives, parted by spaces, the better
/// first; of `spine` and `neck`, all that are there make a chain.
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
    /// The joints that are one bone each, with their names.
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

/// The key of each bone.
pub(super) fn keys(rig: &Rig) -> Vec<Key> {
    let numbered = are_numbered(rig);
    let name = |name: &str| match number(name).filter(|_| numbered) {
        Some((bare, _)) => key(bare),
        None => key(name),
    };
    rig.bones().iter().map(|bone| name(&bone.name)).collect()
}

/// Whether a program has numbered the nodes one by one at the end of their names, as Sketchfab does:
/// `mixamorig:Hips_01`, `mixamorig:Spine_02`.
fn are_numbered(rig: &Rig) -> bool {
    let names = || rig.bones().iter().map(|bone| bone.name.as_str()).filter(|name| !name.is_empty());
    let mut numbers: Vec<u64> = names().filter_map(number).map(|(_, number)| number).collect();
    let found = numbers.len();
    numbers.sort_unstable();
    numbers.dedup();
    // Numbers that names have for themselves, as `spine_01`, come again on other bones.
    found > 8 && 4 * found >= 3 * names().count() && 10 * numbers.len() >= 9 * found
}

/// A name without the number at its end, after `_`, and that number.
fn number(name: &str) -> Option<(&str, u64)> {
    let (bare, number) = name.rsplit_once('_')?;
    let digits = !number.is_empty() && is_number(number) && !bare.is_empty();
    digits.then(|| number.parse().ok()).flatten().map(|number| (bare, number))
}

/// The bone of one of these names, the first of them that there is; of several one that a mesh
/// follows.
pub(super) fn find(rig: &Rig, keys: &[Key], side: Side, alternatives: &str) -> Option<usize> {
    alternatives.split(' ').filter(|text| !text.is_empty()).find_map(|text| {
        let named = (0..keys.len()).filter(|&bone| keys[bone].side == side && keys[bone].text == text);
        named.min_by_key(|&bone| (!rig.bones()[bone].deforms, !keys[bone].deforms))
    })
}

/// Cuts a name.
pub(super) fn key(name: &str) -> Key {
    // A namespace or a path before the name.
    let name = name.rsplit([':', '|', '/']).next().unwrap_or_default();
    let mut words = words(&narrow(name));
    let mut deforms = false;
    drop_prefix(&mut words, &mut deforms);
    let mut side = Side::Middle;
    let sided = words.iter().position(|word| side_of(word).is_some());
    if let Some(at) = sided {
        side = side_of(&words.remove(at)).unwrap_or(side);
    } else if words.len() > 1 && words.last().is_some_and(|word| word == "m") {
        // `Root_M`: M is the side that is none.
        words.pop();
    } else if let Some((found, rest)) = words.first().and_then(|word| sided_word(word)) {
        (side, words[0]) = (found, rest);
    }
    Key { side, text: words.concat(), deforms }
}

/// Digits as wide as Chinese characters as ordinary ones.
fn narrow(name: &str) -> String {
    let digit = |letter: char| char::from_digit(u32::from(letter).wrapping_sub(u32::from('０')), 10);
    name.chars().map(|letter| digit(letter).unwrap_or(letter)).collect()
}

/// Words in small letters: cut at signs, at capitals, and between letters and digits.
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

/// Drops what programs put before every name.
fn drop_prefix(words: &mut Vec<String>, deforms: &mut bool) {
    loop {
        let drop = match words.first().map(String::as_str) {
            Some("def") => {
                *deforms = true;
                1
            }
            // With the number of the copy: `mixamorig1`, `Bip001`.
            Some("mixamorig" | "bip" | "biped") => 1 + usize::from(words.get(1).is_some_and(|w| is_number(w))),
            Some("character") if words.get(1).is_some_and(|word| is_number(word)) => 2,
            Some("j" | "cc" | "base" | "armature" | "facial" | "valve") => 1,
            // `J_Bip_C_Hips`: C is the side that is none.
            Some("c") if words.len() > 1 => 1,
            _ => return,
        };
        // A name that is nothing but prefix is left as it is: it is no body part's.
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

/// A side that was written together with the name, as `leftarm` and `左腕`.
fn sided_word(word: &str) -> Option<(Side, String)> {
    let sides = [("left", Side::Left), ("right", Side::Right), ("左", Side::Left), ("右", Side::Right)];
    sides.into_iter().find_map(|(text, side)| Some((side, word.strip_prefix(text)?.to_owned())))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn cut(name: &str) -> (Side, String) {
        let key = key(name);
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
