//! Other programs' names of ARKit's shapes, in lower case, without the side.

/// Channel names without a side, each with its synonyms: those of Character Creator, Faceshift (and its successors
/// High Fidelity and `FaceScape`), Adobe Fuse, and lists with more shapes than ARKit's.
const SYNONYMS: [(&str, &[&str]); 27] = [
    ("browdown", &["browdrop", "browsd", "browsdown", "browlower"]),
    ("browinnerup", &["browraiseinner", "browinnerraise", "browsuc", "browraisein"]),
    ("browouterup", &["browraiseouter", "browouterraise", "browsu", "browsup", "browraise", "browup", "browraiseout"]),
    ("cheekpuff", &["puff"]),
    ("cheeksquint", &["cheekraise"]),
    ("eyeblink", &["blink", "eyeclose", "eyeclosed"]),
    ("eyelookdown", &["eyedown"]),
    ("eyelookin", &["eyein"]),
    ("eyelookout", &["eyeout"]),
    ("eyelookup", &["eyeup"]),
    ("eyesquint", &["squint"]),
    ("eyewide", &["eyeswide", "eyeopen"]),
    ("jawforward", &["jawfwd", "jawforeward"]),
    ("mouth", &["midmouth"]),
    ("mouthclose", &["lipstogether"]),
    ("mouthfrown", &["frown"]),
    ("mouthfunnel", &["lipsfunnel", "mouthfunnelupper", "mouthfunnellower"]),
    ("mouthlowerdown", &["mouthdownlower", "lipslowerdown", "lowerlipdown"]),
    ("mouthpucker", &["lipspucker"]),
    ("mouthrolllower", &["mouthrollinlower", "lipslowerclose", "lowerlipin"]),
    ("mouthrollupper", &["mouthrollinupper", "lipsupperclose", "upperlipin"]),
    ("mouthshruglower", &["chinlowerraise"]),
    ("mouthshrugupper", &["chinupperraise"]),
    ("mouthsmile", &["smile"]),
    ("mouthstretch", &["lipsstretch"]),
    ("mouthupperup", &["mouthupupper", "lipsupperup", "upperlipup"]),
    ("nosesneer", &["sneer", "nosescrunch"]),
];

/// Synonyms of a channel.
pub(super) fn of(channel: &str) -> impl Iterator<Item = &'static str> {
    let found = SYNONYMS.iter().find(|(known, _)| *known == channel);
    found.into_iter().flat_map(|(_, names)| names.iter().copied())
}

/// Whether a name is ambiguous without a side: `Smile` is an expression, `Smile_Left` a shape.
pub(super) fn need_side(name: &str) -> bool {
    ["blink", "squint", "frown", "smile", "sneer", "eyeopen", "midmouth"].contains(&name)
}
