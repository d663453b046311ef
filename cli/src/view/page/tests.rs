use umo_core::FaceKind;

use super::*;
use crate::view::scene::JudgeInfo;
use crate::view::scene::tests::scene;
use umo_figure::sample;

#[test]
fn no_name_breaks_out_of_the_page() {
    let mut scene = scene(sample::clip(FaceKind::Arkit, 2, 1));
    let evil = "</script><img src=x onerror=alert(1)>{data}&\"'";
    scene.title = evil.to_owned();
    scene.notice = evil.to_owned();
    scene.about = evil.to_owned();
    scene.clip.face.names[3] = evil.to_owned();
    let page = html(&scene).unwrap();
    assert!(!page.contains("<img"), "a name became an element");
    assert!(page.contains("<title>&lt;/script&gt;&lt;img"));
    let opened = page.matches("<script").count();
    assert_eq!(opened, page.matches("</script>").count());
    assert_eq!(page.matches("id=\"scene\"").count(), 1, "a name was filled in again");
    let json = page.split("id=\"scene\">").nth(1).unwrap().split("</script>").next().unwrap();
    let scene: serde_json::Value = serde_json::from_str(json).unwrap();
    assert_eq!((&scene["title"], &scene["face"]["names"][3]), (&evil.into(), &evil.into()));
}

#[test]
fn sources_cannot_end_their_own_element() {
    for (name, source) in MODULES {
        assert!(!source.contains("</script") && !source.contains("<!--"), "{name}");
    }
    assert!(!BOOT.contains("</script") && !STYLE.contains("</style"));
}

#[test]
fn every_module_that_is_imported_is_there() {
    for (name, source) in MODULES.iter().chain([&("boot.js", BOOT)]) {
        for import in source.split("\"umo/").skip(1) {
            let import = import.split('"').next().unwrap();
            assert!(MODULES.iter().any(|(name, _)| *name == import), "{name} imports {import}");
        }
    }
}

#[test]
fn a_page_asks_no_network_for_anything() {
    let judge = JudgeInfo { seconds: 8, frames: 2, takes: Vec::new() };
    for judge in [None, Some(judge)] {
        let page = html(&Scene { judge, ..scene(sample::clip(FaceKind::Arkit, 2, 1)) }).unwrap();
        assert!(page.contains("default-src 'none'") && page.contains("connect-src 'none'"));
        for word in ["http://", "https://", "src=\"", "@import", "url("] {
            assert!(!page.contains(word), "the page has {word}");
        }
    }
}

#[test]
fn filling_takes_values_as_they_are() {
    assert_eq!(fill("a{x}b{y}{x}c", &[("{x}", "{y}"), ("{y}", "2")]), "a{y}b2{y}c");
}
