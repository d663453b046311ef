//! Posing a rig with a volume and its face never allocates, from the first frame on.

mod counting;
#[path = "retarget/rigs.rs"]
#[expect(dead_code, reason = "only some of the bodies are needed here")]
mod rigs;

use std::hint::black_box;
use std::time::Instant;

use counting::{allocated, allocator_calls, check_counter};
use umo_core::{ARKIT_NAMES, Face, FaceKind, FaceMap, Floor, Mapping, Pose, Retarget, Volume};
use umo_core_pose::rotation::{IDENTITY, axis_angle_to_quat};

const FRAMES: u16 = 1000;

fn main() {
    check_counter();
    let face = Face { kind: FaceKind::Arkit, names: ARKIT_NAMES.map(str::to_owned).to_vec() };
    for naming in rigs::ALL {
        let rig = naming.body(&|_| 1.0, 0.7).rig(IDENTITY, 100.0, 0.01, &|_| IDENTITY);
        let (mapping, name) = Mapping::guess(&rig).expect("a rig with known names");
        let mut retarget = Retarget::new(&rigs::source(), &rig, &mapping, Floor::AtRest).expect("a sound rig");
        let plain = retarget.clone();
        let volume = Volume::of_people(&rig, &mapping).expect("arms and legs");
        retarget.set_volume(&rig, &mapping, &volume, 1.0).expect("a sound rig");
        let map = FaceMap::new(&face, &["aa", "ih", "ou", "ee", "oh", "blinkLeft", "blinkRight"]);
        let (mut scratch, mut rotations) = (retarget.scratch(), vec![IDENTITY; rig.len()]);
        let (values, mut weights) = ([0.3_f32; 52], [0.0_f32; 7]);
        let (start, held) = (Instant::now(), allocated());
        let calls = allocator_calls(|| {
            for frame in 0..FRAMES {
                let mut pose = Pose::REST;
                pose.rotations.fill(axis_angle_to_quat([0.001 * f32::from(frame), 0.2, 0.1]));
                black_box(retarget.apply(&mut scratch, &pose, &mut rotations)).expect("room of the right size");
                map.apply(&values, &mut weights);
                assert!(retarget.apply(&mut scratch, &pose, &mut rotations[1..]).is_err());
            }
        });
        assert_eq!((calls, allocated()), (0, held), "{name}");
        let each = start.elapsed().as_secs_f64() / f64::from(FRAMES);
        println!("{name}: {} bones, {:.1} us a frame, no allocation", rig.len(), 1e6 * each);
        // Hands that touch each other before the chest, where most of the work is.
        let mut pose = Pose::REST;
        for (side, sign) in [(0, 1.0), (1, -1.0)] {
            pose.rotations[16 + side] = axis_angle_to_quat([0.0, 0.0, -sign]);
            pose.rotations[18 + side] = axis_angle_to_quat([0.0, -1.9 * sign, 0.0]);
        }
        let mut time = |retarget: &Retarget| {
            let start = Instant::now();
            for _ in 0..FRAMES {
                black_box(retarget.apply(&mut scratch, black_box(&pose), &mut rotations))
                    .expect("room of the right size");
            }
            1e6 * start.elapsed().as_secs_f64() / f64::from(FRAMES)
        };
        println!("  hands together: {:.1} us, {:.1} us without volume", time(&retarget), time(&plain));
    }
}
