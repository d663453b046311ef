//! Rooms with voices that are laid out in time: no model, no sound.

use umo_core_base::state::StatePass;
use umo_core_layers::Role;

use super::draw::{Draws, Purpose, between};
use super::room::{MEMBERS, Room};
use super::*;

const MINUTE: usize = 60 * TICKS_PER_SECOND as usize;

/// A room with members in a circle, who look at its middle.
fn room(count: usize, seed: u64) -> Room<MEMBERS> {
    let mut room = Room::new(seed);
    for i in 0..count {
        let angle = i as f32 / count as f32 * std::f32::consts::TAU;
        let position = [angle.sin(), 0.0, angle.cos()];
        room.add(Place { position, facing: angle + std::f32::consts::PI, eye_height: 1.6 }, true).unwrap();
    }
    room
}

/// Level of a voice that sounds: syllables.
fn syllables(tick: usize) -> f32 {
    let at = 0.5 + 0.5 * (tick as f32 * 1.1).sin();
    0.02 + 0.18 * at * at
}

/// Makes ticks in which these members sound.
fn sound(room: &mut Room<MEMBERS>, ticks: usize, who: &[usize]) {
    for tick in 0..ticks {
        let mut levels = [0.0; MEMBERS];
        who.iter().for_each(|&slot| levels[slot] = syllables(tick));
        room.tick(&levels);
    }
}

/// Turns of a conversation: who has each tick, and whether it sounds; "mhm"s of the others beside it.
struct Talk {
    turns: Vec<(usize, bool)>,
    aside: Vec<Option<usize>>,
}

/// Turns of 2 to 12 s, of phrases of 1 to 3.5 s with pauses of 0.25 to 0.7 s; between them gaps of 0 to 0.5 s.
fn talk(count: usize, minutes: usize, seed: u64) -> Talk {
    let (mut turns, mut aside) = (Vec::new(), Vec::new());
    let (mut speaker, number) = (0, std::cell::Cell::new(0));
    let draws = || Draws::new(seed, 1, number.replace(number.get() + 1), Purpose::Looks);
    let draw = |range: [f32; 2]| between(range, draws().next());
    let other = |than: usize| draws().one_of(((1 << count) - 1) & !(1 << than)).unwrap();
    while turns.len() < minutes * MINUTE {
        let end = turns.len() + ticks(draw([2.0, 12.0])) as usize;
        while turns.len() < end {
            let phrase = ticks(draw([1.0, 3.5]));
            turns.extend((0..phrase).map(|_| (speaker, true)));
            let mhm = if draw([0.0, 1.0]) < 0.25 { ticks(draw([0.25, 0.5])) as usize } else { 0 };
            let who = other(speaker);
            aside.resize(turns.len() - mhm.min(6), None);
            aside.extend(std::iter::repeat_n(Some(who), mhm));
            let pause = ticks(draw([0.25, 0.7]));
            turns.extend((0..pause).map(|_| (speaker, false)));
        }
        speaker = other(speaker);
    }
    aside.resize(turns.len(), None);
    Talk { turns, aside }
}

/// Figures of a talk.
#[derive(Debug, Default)]
struct Found {
    /// Share of contact with the speaker while listening, and with anybody while speaking.
    listening: f32,
    speaking: f32,
    /// Median of the seconds from a turn's first sound to a listener's look, where it looked elsewhere and did not speak
    /// before: who did looks at the others anyway as its phrase ends.
    latency: Option<f32>,
    /// Nods a minute of listening, share of them up to a second after a phrase's end, and of the time.
    nods: f32,
    at_ends: f32,
    of_time: f32,
    /// Share of nods within 0.1 s of another listener's.
    in_step: f32,
    /// Share of the ticks of sound in which the floor is the speaker's.
    floor: f32,
}

fn watch(count: usize, seed: u64) -> Found {
    let Talk { turns, aside } = talk(count, 10, seed);
    let mut room = room(count, seed);
    let (mut there, mut listened, mut at, mut spoke, mut right) = (0, 0, 0, 0, 0);
    let mut latencies = Vec::new();
    let mut waiting: Vec<Option<usize>> = vec![None; count];
    let (mut nods, mut nod_ticks) = (vec![0; count], vec![Vec::new(); count]);
    let (mut since_end, mut at_ends, mut near) = (usize::MAX / 2, 0, 0);
    for (tick, (&(speaker, is_on), &aside)) in turns.iter().zip(&aside).enumerate() {
        let mut levels = [0.0; MEMBERS];
        levels[speaker] = if is_on { syllables(tick) } else { 0.0 };
        if let Some(aside) = aside {
            levels[aside] = syllables(tick + 3);
        }
        room.tick(&levels);
        let is_turn = tick > 0 && turns[tick - 1].0 != speaker;
        since_end = if tick > 0 && turns[tick - 1].1 && !is_on { 0 } else { since_end + 1 };
        near += usize::from(since_end < 30);
        right += usize::from(is_on && room.floor.holder == Some(speaker));
        for slot in 0..count {
            let info = room.info(slot);
            let looks = info.is_contact && info.attends_to == Some(room.members[speaker].id);
            if slot == speaker {
                spoke += usize::from(is_on);
                at += usize::from(is_on && info.is_contact);
            } else {
                listened += usize::from(is_on);
                there += usize::from(is_on && looks);
            }
            if is_turn {
                let heard = slot != speaker && slot != turns[tick - 1].0;
                waiting[slot] = (heard && !looks).then_some(tick);
            } else if let Some(begin) = waiting[slot]
                && looks
            {
                latencies.push((tick - begin) as f32 / 30.0);
                waiting[slot] = None;
            }
            let before = std::mem::replace(&mut nods[slot], info.answers[0]);
            if before != info.answers[0] {
                nod_ticks[slot].push(tick);
                at_ends += usize::from(since_end < 30);
            }
        }
    }
    latencies.sort_by(f32::total_cmp);
    let all: usize = nod_ticks.iter().map(Vec::len).sum();
    let steps = (0..count).flat_map(|slot| nod_ticks[slot].iter().map(move |&tick| (slot, tick)));
    let same = |slot: usize, tick: usize| {
        (0..count).any(|other| other != slot && nod_ticks[other].iter().any(|&nod| nod.abs_diff(tick) <= 3))
    };
    let in_step = steps.filter(|&(slot, tick)| same(slot, tick)).count();
    let listened_minutes = turns.len() as f32 * (count as f32 - 1.0) / MINUTE as f32;
    let sounds = turns.iter().filter(|turn| turn.1).count();
    Found {
        listening: there as f32 / listened as f32,
        speaking: at as f32 / spoke as f32,
        latency: latencies.get(latencies.len() / 2).copied(),
        nods: all as f32 / listened_minutes,
        at_ends: at_ends as f32 / all as f32,
        of_time: near as f32 / turns.len() as f32,
        in_step: in_step as f32 / all as f32,
        floor: right as f32 / sounds as f32,
    }
}

#[test]
fn looks_and_nods_are_those_of_people() {
    for count in [2, 3, 5] {
        for seed in 0..3 {
            let found = watch(count, seed);
            assert!((0.65..0.85).contains(&found.listening), "{count} {found:?}");
            assert!((0.3..0.5).contains(&found.speaking), "{count} {found:?}");
            assert!(found.latency.is_none_or(|median| (0.2..0.4).contains(&median)), "{count} {found:?}");
            assert_eq!(found.latency.is_some(), count > 2);
            assert!((6.0..10.0).contains(&found.nods), "{count} {found:?}");
            assert!(found.at_ends > 1.3 * found.of_time, "{count} {found:?}");
            assert!(found.in_step < 0.12 * (count - 1) as f32, "{count} {found:?}");
            assert!(found.floor > 0.8, "{count} {found:?}");
        }
    }
}

#[test]
fn a_new_speaker_is_found_after_a_fifth_to_two_fifths_of_a_second() {
    let mut latencies = Vec::new();
    for (seed, silence) in (0..100).zip(60..) {
        let mut room = room(4, seed);
        sound(&mut room, silence, &[]);
        let looks =
            |room: &Room<MEMBERS>, slot: usize| room.info(slot).is_contact && room.info(slot).attends_to == Some(1);
        let mut waiting = [1, 2, 3].map(|slot| !looks(&room, slot));
        for tick in 1..30 {
            sound(&mut room, 1, &[0]);
            for (slot, waits) in waiting.iter_mut().enumerate() {
                if *waits && looks(&room, slot + 1) {
                    latencies.push(tick as f32 / 30.0);
                    *waits = false;
                }
            }
        }
        assert_eq!(waiting, [false; 3]);
    }
    latencies.sort_by(f32::total_cmp);
    let [least, median, most] = [1, 10, 19].map(|part| latencies[part * latencies.len() / 20]);
    assert!(least > 0.1 && (0.2..0.4).contains(&median) && most < 0.55, "{least} {median} {most}");
}

#[test]
fn the_floor_goes_to_who_sounds_and_an_mhm_does_not_take_it() {
    let mut room = room(3, 1);
    let holder = |room: &Room<MEMBERS>| room.floor.holder;
    sound(&mut room, 3, &[1]);
    assert_eq!(holder(&room), None, "0.1 s does not take it");
    sound(&mut room, 5, &[1]);
    assert_eq!(holder(&room), Some(1));
    sound(&mut room, 60, &[1]);
    // An "mhm" of half a second into the words, and one into a pause.
    sound(&mut room, 15, &[0, 1]);
    assert_eq!((holder(&room), room.info(0).role), (Some(1), Role::Listening));
    sound(&mut room, 30, &[1]);
    sound(&mut room, 6, &[]);
    sound(&mut room, 15, &[2]);
    assert_eq!(holder(&room), Some(1));
    sound(&mut room, 30, &[1]);
    assert_eq!(holder(&room), Some(1));
    // Half a second of silence: the other who sounds has it at once.
    sound(&mut room, 15, &[]);
    assert_eq!(holder(&room), Some(1));
    sound(&mut room, 6, &[2]);
    assert_eq!((holder(&room), room.info(2).role), (Some(2), Role::Speaking));
    assert_eq!(room.info(1).role, Role::Listening);
    // After longer silence nobody has it.
    sound(&mut room, 60, &[]);
    assert_eq!((holder(&room), room.info(2).role), (None, Role::Idle));
}

#[test]
fn who_falls_silent_first_yields() {
    // Member 0 speaks; member 1 interrupts, and one of them stops.
    for (stops, goes_on) in [(0, 1), (1, 0)] {
        let mut room = room(3, 2);
        sound(&mut room, 90, &[0]);
        sound(&mut room, 30, &[0, 1]);
        assert_eq!(room.floor.holder, Some(0));
        assert!((0..3).all(|slot| room.info(slot).yielding == 0.0));
        sound(&mut room, 12, &[goes_on]);
        assert_eq!(room.floor.holder, Some(goes_on));
        let yielding = |room: &Room<MEMBERS>| [0, 1, 2].map(|slot| room.info(slot).yielding);
        let mut wanted = [0.0; 3];
        wanted[stops] = 1.0;
        assert_eq!(yielding(&room), wanted);
        assert_eq!(room.company(stops).yielding, 1.0);
        sound(&mut room, 45, &[goes_on]);
        assert_eq!(yielding(&room), [0.0; 3]);
    }
    // Together for less than 0.8 s: nobody yields.
    let mut room = room(2, 2);
    sound(&mut room, 90, &[0]);
    sound(&mut room, 18, &[0, 1]);
    sound(&mut room, 12, &[0]);
    assert_eq!(room.info(1).yielding, 0.0);
}

#[test]
fn a_posture_is_followed_late_and_a_third_as_far() {
    let mut room = room(2, 5);
    let mut posture = Vec::new();
    for _ in 0..3 * MINUTE {
        sound(&mut room, 1, &[0]);
        posture.push([0, 1].map(|slot| [room.company(slot).lean, room.company(slot).weight]));
    }
    // A change of the speaker's lean by its own choice changes the listener's by a third, 2 to 4 s later.
    let steps = |slot: usize| -> Vec<(usize, [f32; 2])> {
        let changes = posture
            .windows(2)
            .enumerate()
            .map(|(tick, pair)| (tick, [pair[1][slot][0] - pair[0][slot][0], pair[1][slot][1] - pair[0][slot][1]]));
        changes.filter(|(_, [lean, weight])| lean.abs() > 1e-6 || weight.abs() > 1e-6).collect()
    };
    let (speaker, listener) = (steps(0), steps(1));
    let follows = |&(tick, [lean, weight]): &(usize, [f32; 2])| {
        listener.iter().any(|&(later, [after, aside])| {
            (60..=121).contains(&(later.saturating_sub(tick)))
                && (after - lean / 3.0).abs() < 1e-4
                && (aside + weight / 3.0).abs() < 1e-4
        })
    };
    // The speaker's steps that follow the listener are not followed again.
    let followed = speaker.iter().filter(|step| follows(step)).count();
    assert!((5..=20).contains(&followed), "{followed} of {}", speaker.len());
}

#[test]
fn parts_can_be_forbidden_and_targets_forced() {
    let mut room = room(3, 4);
    let ids = [0, 1, 2].map(|slot| room.members[slot].id);
    room.members[1].allowed = Allowed::NONE;
    room.members[2].target = Target::Point([5.0, 1.0, 5.0]);
    for tick in 0..2 * MINUTE {
        sound(&mut room, 1, if tick % 90 < 70 { &[0] } else { &[] });
        assert_eq!(room.company(1), Company::ALONE);
        room.members[1].allowed = Allowed::YIELD;
        let (free, forced) = (room.company(1), room.company(2));
        assert!(!free.has_place && free.lean == 0.0 && free.weight == 0.0 && free.role.is_some());
        assert!(tick < 90 || free.resting == f32::from(u8::from(free.role == Some(Role::Listening))));
        room.members[1].allowed = Allowed::NONE;
        assert!(forced.has_place && forced.is_contact);
        assert_eq!(room.info(2).attends_to, None);
    }
    assert_eq!(room.info(1).answers, [0; 3]);
    assert!(room.info(2).answers[0] > 5);
    room.members[2].target = Target::Member(ids[1]);
    assert_eq!(room.info(2).attends_to, Some(ids[1]));
    // In a room of its own axes: member 0 is at +Z, member 2 is a third of a turn further.
    let place = room.company(2).place;
    assert!((place[1]).abs() < 1e-6 && place[2] > 0.5, "{place:?}");
    room.remove(1);
    assert_eq!(room.members[2].target, Target::Free);
    room.remove(0);
    assert_eq!(room.company(2), Company::ALONE);
}

#[test]
fn places_are_the_members_own() {
    let mut room = Room::<3>::new(0);
    let place = |position, facing| Place { position, facing, eye_height: 1.5 };
    let half = std::f32::consts::FRAC_PI_2;
    let (listener, _) = room.add(place([1.0, 0.0, 1.0], half), true).unwrap();
    let (near, _) = room.add(Place { eye_height: 1.8, ..place([3.0, 0.5, 1.0], -half) }, true).unwrap();
    room.add(place([1.0, 0.0, -3.0], 0.0), false).unwrap();
    room.members[listener].target = Target::Member(room.members[near].id);
    let [left, up, ahead] = room.company(listener).place;
    assert!(left.abs() < 1e-5 && (up - 0.8).abs() < 1e-5 && (ahead - 2.0).abs() < 1e-5, "{left} {up} {ahead}");
    room.members[listener].target = Target::Member(room.members[2].id);
    let [left, _, ahead] = room.company(listener).place;
    // The left of who faces +X is at -Z.
    assert!((left - 4.0).abs() < 1e-5 && ahead.abs() < 1e-5, "{left} {ahead}");
}

fn save(room: &mut Room<MEMBERS>) -> Vec<u8> {
    let mut size = StatePass::size();
    room.state(&mut size).unwrap();
    let mut bytes = vec![0; size.end().unwrap()];
    let mut pass = StatePass::save(&mut bytes, 0, 0);
    room.state(&mut pass).unwrap();
    assert_eq!(pass.end().unwrap(), bytes.len());
    bytes
}

#[test]
fn a_restored_room_goes_on_the_same() {
    let talk = talk(4, 3, 9);
    let run = |room: &mut Room<MEMBERS>, ticks: std::ops::Range<usize>| -> Vec<_> {
        let each = ticks.map(|tick| {
            let (speaker, is_on) = talk.turns[tick];
            let mut levels = [0.0; MEMBERS];
            levels[speaker] = if is_on { syllables(tick) } else { 0.0 };
            room.tick(&levels);
            [0, 1, 2, 3].map(|slot| room.company(slot))
        });
        each.collect()
    };
    let mut first = room(4, 7);
    run(&mut first, 0..1000);
    let state = save(&mut first);
    let wanted = run(&mut first, 1000..3000);
    let mut other = room(4, 8);
    run(&mut other, 500..700);
    let mut pass = StatePass::check(&state, 0).unwrap();
    other.state(&mut pass).unwrap();
    pass.end().unwrap();
    let mut pass = StatePass::load(&state, 0);
    other.state(&mut pass).unwrap();
    assert_eq!(run(&mut other, 1000..3000), wanted);
    assert_eq!(save(&mut other), save(&mut first));
    // Another member is another room.
    let mut fewer = room(3, 7);
    let mut pass = StatePass::check(&state, 0).unwrap();
    assert!(fewer.state(&mut pass).is_err());
}

#[test]
fn times_that_sum_up_to_a_tick_are_one_and_long_ones_are_cut() {
    for rate in [24_u32, 30, 60, 72, 90, 120, 144, 240] {
        let mut room = Room::<MEMBERS>::new(0);
        let mut made = 0;
        for picture in 1..=3000_u32 {
            let due = room.due(1.0 / f64::from(rate));
            made += due;
            (0..due).for_each(|_| room.tick(&[0.0; MEMBERS]));
            let wanted = f64::from(picture) * 30.0 / f64::from(rate);
            assert!((made as f64 - wanted).abs() < 1.0, "{rate}: {made} of {wanted}");
        }
    }
    let scene = Scene::<Arc<Session>>::new(0).unwrap();
    for seconds in [-1.0, f64::NAN, f64::INFINITY] {
        assert_eq!(scene.update(seconds), Err(SceneError::Time));
    }
}

#[test]
fn people_without_bodies_are_heard() {
    let scene = Scene::<Arc<Session>>::new(3).unwrap();
    let ids = [0.0, 1.0].map(|x| scene.add(None, Place { position: [x, 0.0, 0.0], ..Place::default() }).unwrap());
    assert_eq!(ids, [1, 2]);
    let samples: Vec<f32> = (0..1600).map(|i| 0.3 * (i as f32 * 0.3).sin()).collect();
    // Cut as a device cuts it.
    for picture in 0..30 {
        for piece in samples.chunks(100 + picture) {
            scene.push_audio(2, piece).unwrap();
        }
        scene.push_audio(1, &[f32::NAN, f32::INFINITY, 0.0]).unwrap();
        scene.update(1.0 / 30.0).unwrap();
    }
    assert_eq!(scene.floor(), Ok(Some(2)));
    let level = scene.member(2).unwrap().level;
    assert!((level - 0.3 / 2.0_f32.sqrt()).abs() < 0.01, "{level}");
    assert_eq!(scene.member(1).unwrap().level, 0.0);
    // No more samples: silence, and after a while nobody speaks.
    (0..75).for_each(|_| scene.update(1.0 / 30.0).unwrap());
    assert_eq!((scene.floor(), scene.member(2).unwrap().level), (Ok(None), 0.0));
    scene.remove(2).unwrap();
    assert_eq!(scene.push_audio(2, &samples), Err(SceneError::NoMember(2)));
    assert_eq!(scene.remove(2), Err(SceneError::NoMember(2)));
    assert_eq!(scene.add(None, Place::default()), Ok(3));
}

#[test]
fn what_is_out_of_range_is_refused() {
    let scene = Scene::<Arc<Session>>::new(3).unwrap();
    for place in [
        Place { position: [f32::NAN, 0.0, 0.0], ..Place::default() },
        Place { position: [0.0, 2e4, 0.0], ..Place::default() },
        Place { facing: f32::INFINITY, ..Place::default() },
        Place { eye_height: -1.0, ..Place::default() },
    ] {
        assert_eq!(scene.add(None, place), Err(SceneError::Place));
    }
    let ids: Vec<u32> = (0..MEMBERS).map(|_| scene.add(None, Place::default()).unwrap()).collect();
    assert_eq!(scene.add(None, Place::default()), Err(SceneError::Full));
    assert_eq!(scene.set_target(1, Target::Member(1)), Err(SceneError::Target));
    assert_eq!(scene.set_target(1, Target::Member(99)), Err(SceneError::NoMember(99)));
    assert_eq!(scene.set_target(1, Target::Point([0.0, f32::NAN, 0.0])), Err(SceneError::Target));
    assert_eq!(scene.set_place(0, Place::default()), Err(SceneError::NoMember(0)));
    assert_eq!((Allowed::from_bits(31), Allowed::from_bits(32)), (Some(Allowed::ALL), None));
    // A whole scene of people is saved, and restored.
    scene.update(0.5).unwrap();
    let mut state = vec![0; scene.state_size().unwrap()];
    let needed = state.len();
    assert_eq!(scene.save(&mut state[1..]), Err(SceneError::Short { needed }));
    let length = scene.save(&mut state).unwrap();
    scene.restore(&state[..length]).unwrap();
    assert!(scene.restore(&state[..length - 1]).is_err());
    state[100] ^= 1;
    assert!(scene.restore(&state[..length]).is_err());
    ids.iter().for_each(|&id| scene.remove(id).unwrap());
}

#[test]
fn a_person_at_the_microphone_is_met_as_in_a_scene_of_two() {
    let mut pair = Pair::new(5);
    let mut tell = |ticks: usize, own: bool, person: Option<bool>| {
        let mut all = Vec::new();
        for tick in 0..ticks {
            let level = |sounds: bool| if sounds { syllables(tick) } else { 0.0 };
            all.push(pair.advance(level(own), person.map(level), TICK_SECONDS));
        }
        all
    };
    // Nobody was heard yet: alone.
    assert!(tell(60, true, None).iter().all(|company| *company == Company::ALONE));
    let listens = |company: &Company| company.role == Some(Role::Listening);
    let mut nods = 0;
    for _ in 0..10 {
        tell(20, false, Some(false));
        let heard = tell(100, false, Some(true));
        assert!(heard[10..].iter().all(|company| listens(company) && company.resting == 1.0));
        let there = heard.iter().filter(|company| company.is_contact).count();
        assert!(there > 40, "{there}");
        let [left, up, ahead] = heard[99].place;
        assert!(left.abs() < 1e-5 && up == 0.0 && (ahead - 1.5).abs() < 1e-5, "{left} {up} {ahead}");
        nods = heard[99].nods;
    }
    // 40 s of it: 6 to 10 a minute.
    assert!((4..=7).contains(&nods), "{nods}");
    // The microphone is off, the person still there. The avatar answers; the person interrupts, and it stops.
    tell(60, false, None);
    let own = tell(90, true, None);
    assert!(own[20..].iter().all(|company| company.role == Some(Role::Speaking) && company.yielding == 0.0));
    tell(40, true, Some(true));
    assert!(tell(15, false, Some(true)).iter().any(|company| company.yielding == 1.0));
    pair.reset();
    assert_eq!(pair.advance(0.1, None, TICK_SECONDS), Company::ALONE);
}
