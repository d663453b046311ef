use umo_core::FaceKind;

use super::*;
use crate::view::scene::tests::scene;
use umo_figure::detail::Detail;
use umo_figure::sample;
use umo_figure::{Finish, Helper, Morph};

/// Returns a mesh of three vertices; the last and the first are moved.
fn mesh() -> Mesh {
    Mesh {
        positions: vec![[0.0; 3], [1.0; 3], [2.0; 3]],
        normals: vec![[0.0, 0.0, 1.0]; 3],
        colors: vec![[1; 4], [2; 4], [3; 4]],
        finishes: [4, 5, 6].map(|roughness| Finish { roughness, metalness: 0 }).to_vec(),
        details: vec![Detail::Knit, Detail::Knit, Detail::None],
        detail_places: vec![[0.0; 2], [0.25, 0.75], [0.0; 2]],
        tangents: vec![[0.0; 4]; 3],
        joints: vec![[0; 4]; 3],
        weights: vec![[1.0, 0.0, 0.0, 0.0]; 3],
        helpers: vec![Helper {
            name: "left_elbow_half".to_owned(),
            of: 18,
            hangs_on: 18,
            axis: [1.0, 0.0, 0.0],
            swing: 0.5,
            twist: 0.25,
        }],
        indices: vec![0, 1, 2],
        jaw: vec![0.0; 3],
        head: 0,
        morphs: vec![
            Morph { name: "jawOpen", vertices: vec![2], positions: vec![[5.0; 3]], normals: vec![[0.0; 3]] },
            Morph { name: "tongueOut", vertices: vec![0, 2], positions: vec![[6.0; 3]; 2], normals: vec![[0.0; 3]; 2] },
        ],
    }
}

fn block(page: &str, name: &str) -> Vec<u8> {
    let start = format!("id=\"block-{name}\">");
    let text = page.split(&start).nth(1).expect("the block is there").split('<').next().unwrap();
    BASE64.decode(text.as_bytes()).unwrap()
}

fn numbers(page: &str, name: &str) -> Vec<u32> {
    block(page, name).as_chunks::<4>().0.iter().map(|&n| u32::from_le_bytes(n)).collect()
}

fn floats(page: &str, name: &str) -> Vec<f32> {
    numbers(page, name).into_iter().map(f32::from_bits).collect()
}

#[test]
fn vertices_that_move_come_first_and_triangles_follow_them() {
    let mut scene = scene(sample::clip(FaceKind::Arkit, 1, 1));
    scene.mesh = mesh();
    let page = elements(&scene).unwrap();
    assert_eq!(floats(&page, "positions"), [0.0, 0.0, 0.0, 2.0, 2.0, 2.0, 1.0, 1.0, 1.0]);
    assert_eq!(block(&page, "colors"), [1, 1, 1, 1, 3, 3, 3, 3, 2, 2, 2, 2]);
    assert_eq!(block(&page, "roughness"), [4, 6, 5]);
    assert!(page.contains("{\"of\":18,\"axis\":[1.0,0.0,0.0],\"swing\":0.5,\"twist\":0.25}"));
    assert_eq!(numbers(&page, "indices"), [0, 2, 1]);
    assert_eq!(floats(&page, "detail-places"), [0.25, 0.75]);
    let [across, down] = Detail::Knit.threads();
    let knit = format!("{{\"name\":\"knit\",\"corners\":3,\"threads\":[{across:?},{down:?}]}}");
    assert!(across > 1.0 && page.contains("\"detailed\":1") && page.contains(&knit));
    assert!(block(&page, "detail-knit").starts_with(b"\x89PNG"));
    assert_eq!(numbers(&page, "morph-vertices"), [1, 0, 1]);
    assert!(page.contains("\"moving\":2") && page.contains("{\"name\":\"tongueOut\",\"count\":2}"));
}

#[test]
fn frames_are_rotations_place_and_face() {
    let scene = scene(sample::clip(FaceKind::Arkit, 3, 1));
    let values = floats(&elements(&scene).unwrap(), "frames");
    let width = 55 * 4 + 3 + 52;
    assert_eq!(values.len(), 3 * width);
    let last = &values[2 * width..];
    assert_eq!(last[..220], *scene.clip.rotations[2].as_flattened());
    assert_eq!(last[220..223], scene.clip.translation[2]);
    assert_eq!(last[223..], *scene.clip.face(2));
}

#[test]
fn weights_fill_sixteen_bits() {
    assert_eq!([-1.0, 0.0, 0.5, 1.0, 2.0].map(share), [0, 0, 32768, 65535, 65535]);
}

/// The page draws triangles grouped by relief, one texture after the other.
#[test]
fn triangles_come_by_relief() {
    let scene = scene(sample::clip(FaceKind::Arkit, 1, 1));
    let page = elements(&scene).unwrap();
    let mesh = &scene.mesh;
    let corners = numbers(&page, "indices");
    assert_eq!(corners.len(), mesh.indices.len());
    let order = Order::moving_first(mesh);
    let mut seen: Vec<Detail> = corners.iter().map(|&new| mesh.details[order.old[new as usize] as usize]).collect();
    let places = floats(&page, "detail-places");
    assert_eq!(places.len(), 2 * order.detailed);
    for (at, place) in places.as_chunks::<2>().0.iter().enumerate() {
        assert_eq!(mesh.detail_places[order.old[order.moving + at] as usize], *place);
    }
    assert!(seen.is_sorted());
    seen.dedup();
    assert_eq!(seen, [Detail::None, Detail::Knit, Detail::Twill, Detail::Leather]);
}
