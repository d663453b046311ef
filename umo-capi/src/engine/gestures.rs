//! Gestures that an engine's new sessions know.

use std::ffi::{CString, c_char};
use std::sync::{Mutex, MutexGuard, PoisonError};

use umo_core::{Gesture, Gestures, LoadError};
use umo_core_base::memory;

use crate::status::Failure;

/// Gestures for an engine's new sessions.
pub(crate) struct Known(Mutex<Set>);

struct Set {
    gestures: Gestures,
    /// Names with their zero bytes. A string that was handed out is never moved.
    names: Vec<CString>,
}

impl Known {
    pub(crate) fn new() -> Self {
        let gestures = Gestures::new();
        let names = gestures.names().filter_map(|name| CString::new(name).ok()).collect();
        Self(Mutex::new(Set { gestures, names }))
    }

    /// Adds or replaces a gesture; a replaced one keeps its index.
    pub(crate) fn add(&self, gesture: Gesture) -> Result<(), Failure> {
        let mut set = self.lock();
        let Set { gestures, names } = &mut *set;
        // All memory is allocated before anything changes.
        let (changed, new) = memory::watch(|| {
            let mut changed = gestures.clone();
            changed.add(gesture).map_err(refused)?;
            let listed = |name: &str| names.iter().any(|known| known.to_bytes() == name.as_bytes());
            let new = changed.names().find(|name| !listed(name)).and_then(|name| CString::new(name).ok());
            names.reserve(1);
            Ok::<_, Failure>((changed, new))
        })??;
        *gestures = changed;
        names.extend(new);
        Ok(())
    }

    fn lock(&self) -> MutexGuard<'_, Set> {
        // A panic while it was locked left the set unchanged or fully updated.
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Clones the gestures, which share their data.
    pub(crate) fn gestures(&self) -> Gestures {
        self.lock().gestures.clone()
    }

    /// Returns the zero-terminated name of a gesture; its memory is unchanged while the engine lives.
    pub(crate) fn name(&self, index: u32) -> Result<*const c_char, Failure> {
        let known = self.lock();
        let none = || Failure::argument(format_args!("gesture {index}: there are {}", known.names.len()));
        known.names.get(index as usize).map(|name| name.as_ptr()).ok_or_else(none)
    }
}

/// Converts the error of a gesture that could not be made.
pub(crate) fn refused(error: LoadError) -> Failure {
    match error {
        LoadError::Memory(missing) => missing.into(),
        error => Failure::argument(error),
    }
}
