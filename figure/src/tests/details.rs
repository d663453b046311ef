//! Relief: directions on the surface, scale, seams.

use super::*;
use crate::detail::Detail;
use vector::{add, cross, dot, length, scale};

fn triangles(mesh: &Mesh) -> impl Iterator<Item = [usize; 3]> + '_ {
    mesh.indices.as_chunks::<3>().0.iter().map(|corners| corners.map(|i| i as usize))
}

/// Threshold of the scale below which a triangle is ignored: parts that close sleeves, legs, waist and belt inside
/// other clothes are squeezed to a line on the map.
const SQUEEZED: f32 = 0.35;

fn area(mesh: &Mesh, corners: [usize; 3]) -> f32 {
    let [a, b, c] = corners.map(|i| mesh.positions[i]);
    0.5 * length(cross(sub(b, a), sub(c, a)))
}

/// Scale of a triangle on its map, in metres, relative to its size; a ratio of lengths, not areas.
fn scale_of(mesh: &Mesh, corners: [usize; 3]) -> f32 {
    let [wide, tall] = mesh.details[corners[0]].repeat_m();
    let [[a, b], [c, d], [e, f]] = corners.map(|i| mesh.detail_places[i]);
    let on_map = 0.5 * ((c - a) * (f - b) - (d - b) * (e - a)).abs() * wide * tall;
    (on_map / area(mesh, corners).max(1e-12)).sqrt()
}

#[test]
fn tangents_are_unit_and_across_the_normal_where_there_is_relief() {
    for mesh in FIGURES.iter().chain(ALL.iter()) {
        for (vertex, (&[x, y, z, w], detail)) in mesh.tangents.iter().zip(&mesh.details).enumerate() {
            if *detail == Detail::None {
                assert_eq!(([x, y, z, w], mesh.detail_places[vertex]), ([0.0; 4], [0.0; 2]));
            } else {
                assert!((length([x, y, z]) - 1.0).abs() < 1e-5, "vertex {vertex}");
                assert!(dot([x, y, z], mesh.normals[vertex]).abs() < 1e-5, "vertex {vertex}");
                assert!(w == 1.0 || w == -1.0);
            }
        }
        for corners in triangles(mesh) {
            assert!(corners.iter().all(|&corner| mesh.details[corner] == mesh.details[corners[0]]));
        }
    }
}

/// Tests the definition independently of the code that computes tangents: the change of the map coordinates along the
/// triangle.
#[test]
fn tangents_go_where_places_on_the_map_do() {
    for mesh in FIGURES.iter().chain(ALL.iter()) {
        let (mut all, mut squeezed, mut off, mut wrong) = (0.0, 0.0, 0.0, 0.0);
        for corners in triangles(mesh).filter(|corners| mesh.details[corners[0]] != Detail::None) {
            let places = corners.map(|i| mesh.detail_places[i]);
            let points = corners.map(|i| mesh.positions[i]);
            let size = area(mesh, corners);
            all += size;
            if scale_of(mesh, corners) < SQUEEZED {
                squeezed += size;
                continue;
            }
            // The gradients of u and v on the triangle, not of unit length.
            let normal = cross(sub(points[1], points[0]), sub(points[2], points[0]));
            let gradient = |axis: usize| {
                (0..3).fold([0.0; 3], |sum, k| {
                    let edge = sub(points[(k + 2) % 3], points[(k + 1) % 3]);
                    add(sum, scale(cross(normal, edge), places[k][axis]))
                })
            };
            let (rise_u, rise_v) = (gradient(0), gradient(1));
            let mean = corners.iter().fold([0.0; 3], |sum, &i| {
                let [x, y, z, _] = mesh.tangents[i];
                add(sum, [x, y, z])
            });
            // Along the tangent u rises, and v is nearly constant.
            let (along, astray) = (dot(rise_u, mean), dot(rise_v, mean));
            if along <= 0.0 || astray.abs() * length(rise_u) > 0.5 * along * length(rise_v) {
                off += size;
            }
            for &i in &corners {
                let [x, y, z, w] = mesh.tangents[i];
                let up = scale(cross(mesh.normals[i], [x, y, z]), w);
                if dot(up, rise_v) >= 0.0 {
                    wrong += size / 3.0;
                }
            }
        }
        assert!(squeezed < 0.12 * all, "{squeezed} of {all} m² are squeezed");
        assert!(all > 0.5, "{all} m² have relief");
        assert!(off < 0.03 * all, "{off} of {all} m²");
        assert!(wrong < 0.01 * all, "{wrong} of {all} m²");
    }
}

/// A repeat has the stated size, except where fabric narrows and on parts that other clothes hide.
#[test]
fn relief_has_the_size_that_is_stated() {
    for mesh in ALL.iter() {
        for detail in Detail::RELIEFS {
            let mut scales: Vec<(f32, f32)> = triangles(mesh)
                .filter(|corners| mesh.details[corners[0]] == detail)
                .map(|corners| (scale_of(mesh, corners), area(mesh, corners)))
                .filter(|one| one.0 >= SQUEEZED)
                .collect();
            if scales.is_empty() {
                continue;
            }
            scales.sort_by(|a, b| a.0.total_cmp(&b.0));
            let all: f32 = scales.iter().map(|one| one.1).sum();
            let at = |share: f32| {
                let mut sum = 0.0;
                scales
                    .iter()
                    .find(|one| {
                        sum += one.1;
                        sum >= share * all
                    })
                    .unwrap()
                    .0
            };
            assert!((0.8..1.25).contains(&at(0.5)), "{detail:?}: {}", at(0.5));
            // A shoe is not a tube: its sides are folded out.
            let [low, high] = if detail == Detail::Leather { [0.5, 2.0] } else { [0.6, 1.6] };
            assert!(at(0.1) > low && at(0.9) < high, "{detail:?}: {} to {}", at(0.1), at(0.9));
        }
    }
}

/// Duplicates of a vertex differ by whole repeats, except at seams between two pieces of cloth.
#[test]
fn relief_goes_on_where_a_surface_begins_again() {
    for mesh in ALL.iter() {
        let (mut copies, mut seams) = (0, 0);
        for (vertex, original) in
            mesh.originals().into_iter().enumerate().filter(|(vertex, original)| vertex != original)
        {
            copies += 1;
            let [p, q] = [vertex, original].map(|i| mesh.detail_places[i]);
            let step = [0, 1].map(|axis: usize| p[axis] - q[axis]);
            let [a, b] = [vertex, original].map(|i| mesh.tangents[i]);
            let is_whole = (step[0] - step[0].round()).abs() < 1e-3 && step[0].abs() > 0.5 && step[1].abs() < 1e-3;
            let is_along = (0..4).all(|k| (a[k] - b[k]).abs() < 1e-4);
            seams += usize::from(!(is_whole && is_along));
        }
        assert!(copies - seams > 50 && seams < 600, "{seams} of {copies} copies are on seams");
    }
}

#[test]
fn skin_and_head_have_no_relief_and_each_figure_has_cloth_and_leather() {
    for mesh in ALL.iter() {
        assert!(mesh.details[mesh.head..].iter().all(|&detail| detail == Detail::None));
        for (detail, finish) in mesh.details.iter().zip(&mesh.finishes) {
            assert!(*detail == Detail::None || ![Finish::SKIN, Finish::NAIL, Finish::BRASS].contains(finish));
        }
        for detail in [Detail::Twill, Detail::Leather] {
            assert!(mesh.details.contains(&detail));
        }
        assert!(mesh.details.contains(&Detail::Knit) != mesh.details.contains(&Detail::StitchedWeave));
    }
}

/// Scale of the stitches relative to the stated one, across and along: the range of the middle 80 % of a surface's
/// area.
fn spread(mesh: &Mesh, has: impl Fn(V) -> bool) -> [[f32; 2]; 2] {
    let mut found: [Vec<(f32, f32)>; 2] = [Vec::new(), Vec::new()];
    for corners in triangles(mesh) {
        let points = corners.map(|i| mesh.positions[i]);
        let is_cloth = [Detail::Knit, Detail::Weave, Detail::Twill].contains(&mesh.details[corners[0]]);
        if !is_cloth || !points.iter().all(|&p| has(p)) || scale_of(mesh, corners) < SQUEEZED {
            continue;
        }
        let [wide, tall] = mesh.details[corners[0]].repeat_m();
        let places = corners.map(|i| mesh.detail_places[i]);
        let normal = cross(sub(points[1], points[0]), sub(points[2], points[0]));
        // Gradients of u and v along the triangle, per metre, times the stated size of a repeat.
        for (axis, repeat) in [wide, tall].into_iter().enumerate() {
            let rise = (0..3).fold([0.0; 3], |sum, k| {
                let edge = sub(points[(k + 2) % 3], points[(k + 1) % 3]);
                add(sum, scale(cross(normal, edge), places[k][axis]))
            });
            let steep = length(rise) / dot(normal, normal).max(1e-18);
            found[axis].push((1.0 / (steep * repeat), area(mesh, corners)));
        }
    }
    found.map(|mut sizes| {
        sizes.sort_by(|a, b| a.0.total_cmp(&b.0));
        let all: f32 = sizes.iter().map(|one| one.1).sum();
        [0.1, 0.9].map(|share| {
            let mut sum = 0.0;
            let found = sizes.iter().find(|one| {
                sum += one.1;
                sum >= share * all
            });
            found.expect("a surface").0
        })
    })
}

/// Holds for clothes cut from flat cloth; `docs/avatar.md` has the figures that `--nocapture` prints.
#[test]
fn stitches_are_of_one_size_on_tops_and_trousers() {
    let rest = rest::Rest::new(&sample::skeleton()).unwrap();
    let [shoulder, hip] = ["shoulder", "hip"].map(|joint| rest.side("left", joint));
    type Has = fn(V, V, V) -> bool;
    let surfaces: [(&str, Has); 4] = [
        ("chest", |p, shoulder, hip| p[0].abs() < shoulder[0] && p[1] > hip[1] + 0.1 && p[1] < shoulder[1] - 0.1),
        ("shoulders", |p, shoulder, _| p[0].abs() < shoulder[0] && p[1] > shoulder[1] - 0.1),
        ("sleeves", |p, shoulder, _| p[0].abs() > shoulder[0]),
        ("legs", |p, _, hip| p[1] < hip[1] && p[0].abs() < 0.4),
    ];
    for mesh in ALL.iter() {
        for (name, has) in surfaces {
            let [across, along] = spread(mesh, |p| has(p, shoulder, hip));
            println!("{name}: across {across:.2?}, along {along:.2?}");
            let most = if name == "shoulders" { 1.12 } else { 1.06 };
            for [low, high] in [across, along] {
                assert!(low > 1.0 / most && high < most, "{name}: across {across:?}, along {along:?}");
            }
        }
    }
}
