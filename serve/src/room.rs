//! Rooms: sessions that join one by its name see each other.
//!
//! A room is in real time: its scene ticks as the clock does, and each tick its members' frames may go out by one, so that
//! what a member does answers what the others show.

use std::collections::HashMap;
use std::f32::consts::{PI, TAU};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use tokio::time::Instant;
use umo_core::{MAX_MEMBERS, Place, Scene, SceneError, Session};

/// Maximum length of a room's name, bytes.
const NAME: usize = 64;
/// Ticks of a scene a second, the most that are caught up on at once, and seconds of a tick.
const RATE: u32 = 30;
const CATCH_UP: u64 = 8;
const TICK: f64 = 1.0 / RATE as f64;
/// Distance of the first seats from the room's centre, metres, and how much further the last are.
const RADIUS: f32 = 1.0;
const SPREAD: f32 = 2.0;

/// The rooms of a server that have members.
#[derive(Debug, Default)]
pub(crate) struct Rooms(Mutex<HashMap<String, Arc<Mutex<Room>>>>);

#[derive(Debug)]
struct Room {
    scene: Scene<Arc<Session>>,
    seats: [bool; MAX_MEMBERS],
    begun: Instant,
    ticks: u64,
}

/// A session's membership. It leaves the room on drop.
#[derive(Debug)]
pub(crate) struct Membership {
    rooms: Arc<Rooms>,
    name: String,
    room: Arc<Mutex<Room>>,
    member: u32,
    seat: usize,
    /// Ticks of the room that the session's frames have followed.
    followed: u64,
}

fn locked<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Rooms {
    /// Lets a session join a room, which begins with its first member; without a place at one of the seats around the
    /// room's centre. Errors are for the client.
    pub(crate) fn join(
        self: &Arc<Self>,
        name: &str,
        place: Option<[f32; 3]>,
        session: &Arc<Session>,
    ) -> Result<Membership, String> {
        if name.is_empty() || name.len() > NAME {
            return Err(format!("room: expected a name of 1 to {NAME} bytes"));
        }
        let mut rooms = locked(&self.0);
        let room = match rooms.get(name) {
            Some(room) => Arc::clone(room),
            None => {
                let scene = Scene::new(seed(name)).map_err(|error| error.to_string())?;
                Arc::new(Mutex::new(Room { scene, seats: [false; MAX_MEMBERS], begun: Instant::now(), ticks: 0 }))
            }
        };
        let mut inside = locked(&room);
        let full = || format!("room `{name}` has {MAX_MEMBERS} members");
        let seat = inside.seats.iter().position(|&taken| !taken).ok_or_else(full)?;
        let place = place.map_or_else(|| at_seat(seat), at);
        let member = inside.scene.add(Some(Arc::clone(session)), place).map_err(|error| error.to_string())?;
        inside.seats[seat] = true;
        let followed = inside.ticks;
        drop(inside);
        rooms.insert(name.to_owned(), Arc::clone(&room));
        Ok(Membership { rooms: Arc::clone(self), name: name.to_owned(), room, member, seat, followed })
    }
}

impl Membership {
    /// Moves the member; the error is for the client.
    pub(crate) fn place(&self, place: [f32; 3]) -> Result<(), String> {
        locked(&self.room).scene.set_place(self.member, at(place)).map_err(|error: SceneError| error.to_string())
    }

    /// Whether the member has company.
    pub(crate) fn has_company(&self) -> bool {
        locked(&self.room).seats.iter().filter(|&&taken| taken).count() > 1
    }

    /// Advances the room to now; returns the number of frames that the session may send.
    pub(crate) fn due(&mut self, now: Instant) -> usize {
        let mut room = locked(&self.room);
        let ticks = now.saturating_duration_since(room.begun).as_micros() * u128::from(RATE) / 1_000_000;
        let ticks = u64::try_from(ticks).unwrap_or(u64::MAX);
        for _ in 0..ticks.saturating_sub(room.ticks).min(CATCH_UP) {
            // Under this lock no other call is in progress.
            let _ = room.scene.update(TICK);
        }
        room.ticks = room.ticks.max(ticks);
        let due = room.ticks.saturating_sub(self.followed).min(CATCH_UP);
        self.followed = room.ticks;
        due as usize
    }
}

impl Drop for Membership {
    fn drop(&mut self) {
        let mut rooms = locked(&self.rooms.0);
        let mut room = locked(&self.room);
        let _ = room.scene.remove(self.member);
        room.seats[self.seat] = false;
        if !room.seats.contains(&true) {
            rooms.remove(&self.name);
        }
    }
}

/// A place given as x and z in metres, and degrees to the left of +Z.
fn at([x, z, degrees]: [f32; 3]) -> Place {
    Place { position: [x, 0.0, z], facing: degrees.to_radians(), ..Place::default() }
}

/// A seat around the centre, which it faces: the first two opposite each other, the next ones between them.
fn at_seat(seat: usize) -> Place {
    let turn = u32::try_from(seat).unwrap_or(0).reverse_bits() as f32 / 2.0_f32.powi(32);
    let radius = RADIUS + SPREAD * (seat as f32 / MAX_MEMBERS as f32);
    let (sin, cos) = (TAU * turn).sin_cos();
    Place { position: [radius * sin, 0.0, radius * cos], facing: TAU * turn + PI, ..Place::default() }
}

/// A seed of the room's name, so that the same room is the same on every server: FNV-1a.
fn seed(name: &str) -> u64 {
    name.bytes().fold(0xCBF2_9CE4_8422_2325, |hash, byte| (hash ^ u64::from(byte)).wrapping_mul(0x0100_0000_01B3))
}
