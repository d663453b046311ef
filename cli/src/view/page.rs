//! The HTML file: the sources in `page/` combined into one file that opens from disk and makes no network requests.

use super::blocks;
use super::scene::Scene;
use crate::failure::Failure;

/// The template of a page with one motion; names in braces are placeholders.
const ONE: &str = concat!(include_str!("page/head.html"), include_str!("page/page.html"));
/// The template of the page to judge.
const JUDGE: &str = concat!(include_str!("page/head.html"), include_str!("page/judge.html"));
const STYLE: &str = include_str!("page/page.css");
/// Script that resolves the modules' imports and starts the main one.
const BOOT: &str = include_str!("page/boot.js");

macro_rules! modules {
    ($($name:literal)*) => { [$(($name, include_str!(concat!("page/", $name)))),*] };
}

/// The modules: name and source.
const MODULES: [(&str, &str); 36] = modules!(
    "body.js" "bones.js" "camera.js" "character.js" "clock.js" "drop.js" "editor.js" "experts.js" "fields.js" "figure.js"
    "gl.js" "gltf.js" "ground.js" "inspect.js" "judge.js" "keys.js" "lanes.js" "light.js" "live.js" "local.js" "main.js" "mask.js" "math.js" "microphone.js"
    "motion.js" "panel.js" "picture.js" "record.js" "room.js" "scene.js" "score.js" "takes.js" "timeline.js" "tracks.js" "trials.js" "video.js"
);

/// Returns a page that shows a scene.
pub(super) fn html(scene: &Scene) -> Result<String, Failure> {
    let data = blocks::elements(scene).map_err(Failure::environment)?;
    // Sources that the page may load from: a program's streams, or the files beside it.
    let (connect, files) = match &scene.live {
        None if scene.takes.as_ref().is_some_and(|takes| takes.kept.is_some()) => ("'self'", ""),
        None => ("'none'", ""),
        Some(live) if live.engine.is_some() => ("'self'", " 'self'"),
        Some(_) => ("'self' ws://127.0.0.1:* ws://localhost:*", ""),
    };
    let compile = if files.is_empty() { "" } else { " 'self' 'wasm-unsafe-eval'" };
    let (template, main) = if scene.judge.is_some() { (JUDGE, "umo/judge.js") } else { (ONE, "umo/main.js") };
    Ok(fill(
        template,
        &[
            ("{main}", main),
            ("{title}", &escaped(&scene.title)),
            ("{notice}", &escaped(&scene.notice)),
            ("{about}", &escaped(&scene.about)),
            ("{connect}", connect),
            ("{compile}", compile),
            ("{files}", files),
            ("{experts}", if scene.record.is_some() { "" } else { " hidden" }),
            ("{style}", STYLE),
            ("{data}", &data),
            ("{modules}", &modules()),
            ("{boot}", BOOT),
        ],
    ))
}

/// Returns the modules as script elements that `boot.js` starts.
fn modules() -> String {
    let element = |(name, source): &(&str, &str)| {
        format!("<script type=\"text/umo-module\" data-name=\"{name}\">\n{source}</script>\n")
    };
    MODULES.iter().map(element).collect()
}

/// Replaces placeholders by their values; values are not searched for placeholders.
fn fill(template: &str, values: &[(&str, &str)]) -> String {
    let (mut page, mut rest) = (String::new(), template);
    let next = |rest: &str| values.iter().filter_map(|(name, value)| Some((rest.find(name)?, *name, *value))).min();
    while let Some((at, name, value)) = next(rest) {
        page += &rest[..at];
        page += value;
        rest = &rest[at + name.len()..];
    }
    page + rest
}

/// Escapes text for HTML content and attributes.
fn escaped(text: &str) -> String {
    let escape = |c: char| match c {
        '&' => "&amp;".to_owned(),
        '<' => "&lt;".to_owned(),
        '>' => "&gt;".to_owned(),
        '"' => "&quot;".to_owned(),
        '\'' => "&#39;".to_owned(),
        c => c.to_string(),
    };
    text.chars().map(escape).collect()
}

#[cfg(test)]
mod tests;
