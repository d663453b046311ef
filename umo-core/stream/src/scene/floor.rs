//! Who has the floor: one at a time, however many sound.

use umo_core_base::state::{StateError, StatePass};

use super::room::Member;
use super::voice::Voice;
use super::{slot_state, ticks};

/// Sound that takes an empty floor.
const TAKES: u32 = ticks(0.15);
/// Silence of the holder after which another may take it, and after which nobody has it.
const FREE: u32 = ticks(0.5);
const EMPTY: u32 = ticks(1.5);
/// Sound that takes it although it began before the floor was free: anything shorter is an "mhm".
const MHM: u32 = ticks(0.7);
/// Time for which two sound until it is an interruption.
const INTERRUPTION: u32 = ticks(0.8);
/// Silence of the holder after which another one's breath may still be part of it.
const OWN_HOLD: u32 = ticks(0.6);

/// The floor, and whom all attend to.
#[derive(Debug)]
pub(super) struct Floor<const N: usize> {
    pub(super) holder: Option<usize>,
    /// Who is heard: the holder, or another one that sounds while the holder is silent.
    pub(super) focus: Option<usize>,
    /// For how long each has sounded together with the holder.
    over: [u32; N],
    /// Who yields at this tick.
    pub(super) yields: Option<usize>,
}

impl<const N: usize> Floor<N> {
    pub(super) fn new() -> Self {
        Self { holder: None, focus: None, over: [0; N], yields: None }
    }

    /// Forgets a member that leaves.
    pub(super) fn forget(&mut self, slot: usize) {
        self.over[slot] = 0;
        for who in [&mut self.holder, &mut self.focus, &mut self.yields] {
            *who = who.filter(|&who| who != slot);
        }
    }

    /// Follows the voices by one tick.
    pub(super) fn advance(&mut self, members: &[Member; N]) {
        self.yields = None;
        let voice = |slot: usize| members[slot].is_there().then_some(&members[slot].voice);
        if let Some(holder) = self.holder {
            self.hold(holder, &voice);
        }
        if self.holder.is_none() {
            self.give(longest::<N>(&voice, None, |voice| voice.heard >= TAKES));
        }
        let heard = self.holder.filter(|&holder| voice(holder).is_some_and(Voice::sounds));
        let other = || longest::<N>(&voice, self.holder, |_| true);
        self.focus = heard.or_else(other).or(self.holder);
    }

    /// Whether a member speaks, for itself: it has the floor or is heard, and not only with an "mhm" into another's words.
    pub(super) fn is_speaker(&self, slot: usize, voice: &Voice) -> bool {
        let is_heard = self.holder == Some(slot) || self.focus == Some(slot);
        is_heard && voice.silent < OWN_HOLD || voice.sounds() && voice.run >= MHM
    }

    fn hold<'a>(&mut self, holder: usize, voice: &impl Fn(usize) -> Option<&'a Voice>) {
        let Some(own) = voice(holder) else { return self.give(None) };
        for slot in (0..N).filter(|&slot| slot != holder) {
            let Some(other) = voice(slot) else { continue };
            let over = self.over[slot];
            if !other.sounds() {
                if over >= INTERRUPTION && own.sounds() {
                    self.yields = Some(slot);
                }
                self.over[slot] = 0;
            } else if own.sounds() {
                self.over[slot] = over.saturating_add(1);
            }
        }
        if own.sounds() {
            return;
        }
        let over = self.over;
        let interrupts = (0..N).filter(|&slot| slot != holder && over[slot] >= INTERRUPTION);
        if let Some(next) = interrupts.max_by_key(|&slot| (over[slot], std::cmp::Reverse(slot))) {
            self.yields = Some(holder);
            return self.give(Some(next));
        }
        if own.silent >= FREE {
            let free = own.silent - FREE;
            let takes = |voice: &Voice| voice.run >= MHM || voice.heard >= TAKES && voice.run <= free;
            match longest::<N>(voice, Some(holder), takes) {
                Some(next) => self.give(Some(next)),
                None if own.silent >= EMPTY => self.give(None),
                None => {}
            }
        }
    }

    fn give(&mut self, holder: Option<usize>) {
        (self.holder, self.over) = (holder, [0; N]);
    }

    pub(super) fn state(&mut self, pass: &mut StatePass, there: u32) -> Result<(), StateError> {
        slot_state(pass, &mut self.holder, there)?;
        slot_state(pass, &mut self.focus, there)?;
        slot_state(pass, &mut self.yields, there)?;
        pass.ids(&mut self.over)
    }
}

/// Of those that sound, and of whom `is` is true, the one that has sounded longest.
fn longest<'a, const N: usize>(
    voice: &impl Fn(usize) -> Option<&'a Voice>,
    but: Option<usize>,
    is: impl Fn(&Voice) -> bool,
) -> Option<usize> {
    let run = |slot: usize| {
        let voice = voice(slot).filter(|voice| Some(slot) != but && voice.sounds() && is(voice))?;
        Some((voice.run, std::cmp::Reverse(slot), slot))
    };
    (0..N).filter_map(run).max().map(|(_, _, slot)| slot)
}
