//! Caught panics of this library: message and place, kept for the caller instead of printed.
//!
//! A panic is a defect of this library. [`contain`] keeps it from propagating to the caller; [`keep_quiet`] keeps it
//! off the process's standard error, where a host's users would see it.

use std::any::Any;
use std::cell::Cell;
use std::fmt;
use std::panic::{AssertUnwindSafe, Location, PanicHookInfo, catch_unwind};
use std::sync::{Mutex, Once, PoisonError};

use umo_kernels::environment::in_default;

/// A caught panic.
#[derive(Clone, PartialEq, Eq)]
pub struct Defect {
    place: String,
    message: String,
}

impl Defect {
    fn new(place: Option<&Location>, payload: &(dyn Any + Send)) -> Self {
        let message = match (payload.downcast_ref::<&str>(), payload.downcast_ref::<String>()) {
            (Some(message), _) => message,
            (_, Some(message)) => message.as_str(),
            _ => "a panic without a message",
        };
        let place = place.map_or_else(String::new, |place| format!("{}:{}", plain(place.file()), place.line()));
        Self { place, message: message.to_owned() }
    }

    /// File and line of the panic; empty if unknown, because the process's own panic hook reported it.
    pub fn place(&self) -> &str {
        &self.place
    }

    /// Message of the panic.
    pub fn message(&self) -> &str {
        &self.message
    }
}

impl fmt::Display for Defect {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.place() {
            "" => write!(f, "{}", self.message),
            place => write!(f, "{place}: {}", self.message),
        }
    }
}

impl fmt::Debug for Defect {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "Defect({self})")
    }
}

/// Most recent panics seen by the hook: a caught panic's payload does not carry its place.
static LAST: Mutex<Last> = Mutex::new(Last { defects: [const { None }; 8], next: 0 });

struct Last {
    defects: [Option<Defect>; 8],
    /// Index for the next defect.
    next: usize,
}

impl Last {
    fn keep(&mut self, defect: Defect) {
        self.defects[self.next] = Some(defect);
        self.next = (self.next + 1) % self.defects.len();
    }

    fn take(&mut self, message: &str) -> Option<Defect> {
        self.defects.iter_mut().find_map(|kept| kept.take_if(|kept| kept.message == *message))
    }
}

thread_local! {
    /// Nesting depth of [`contain_quietly`] on this thread. Has no destructor.
    static DEPTH: Cell<u32> = const { Cell::new(0) };
}

/// Runs `work` in the default floating-point environment, whatever the caller's is, and returns a panic as an error.
/// The caller's environment is restored.
///
/// # Errors
/// [`Defect`] if `work` panicked.
pub fn contain<R>(work: impl FnOnce() -> R) -> Result<R, Defect> {
    catch_unwind(AssertUnwindSafe(|| in_default(work))).map_err(|payload| {
        let payload = match payload.downcast::<Defect>() {
            Ok(defect) => return *defect,
            Err(payload) => payload,
        };
        let caught = Defect::new(None, &*payload);
        LAST.lock().unwrap_or_else(PoisonError::into_inner).take(&caught.message).unwrap_or(caught)
    })
}

/// Like [`contain`]; after [`keep_quiet`], panics of `work` on this thread are not printed either, in whichever
/// library they occur. Uses thread-local storage, which the system may allocate on a thread's first call.
///
/// # Errors
/// As in [`contain`].
pub fn contain_quietly<R>(work: impl FnOnce() -> R) -> Result<R, Defect> {
    DEPTH.set(DEPTH.get() + 1);
    let result = contain(work);
    DEPTH.set(DEPTH.get() - 1);
    result
}

/// Continues a panic that was caught on another thread, for [`contain`] to catch again. Prints nothing.
pub(crate) fn resume(defect: Defect) -> ! {
    std::panic::resume_unwind(Box::new(defect))
}

/// Stops printing panics of this library from now on: panics in its source files and in [`contain_quietly`]. All
/// others go to the previous panic hook. Source files in the directories of `files` count as this library's, too.
///
/// Only the first call has an effect. For libraries that hide this one behind another interface.
pub fn keep_quiet(files: &'static [&'static [&'static str]]) {
    static HOOK: Once = Once::new();
    HOOK.call_once(|| {
        let previous = std::panic::take_hook();
        std::panic::set_hook(Box::new(move |info| {
            if is_own(info, files) {
                let defect = Defect::new(info.location(), info.payload());
                LAST.lock().unwrap_or_else(PoisonError::into_inner).keep(defect);
            } else {
                previous(info);
            }
        }));
    });
}

fn is_own(info: &PanicHookInfo, files: &[&[&str]]) -> bool {
    let file = info.location().map_or("", Location::file);
    let own = [crate::SOURCE, umo_kernels::SOURCE];
    // At a thread's end its storage may be gone; no code of this library runs then.
    DEPTH.try_with(Cell::get).is_ok_and(|depth| depth > 0)
        || own.iter().chain(files.iter().copied().flatten()).any(|own| file.starts_with(folder(own)))
}

/// Path of a source file without the `./` that nested modules may give it.
fn plain(file: &str) -> String {
    file.replace("/./", "/").replace(r"\.\", r"\")
}

/// Directory of a source file, with its trailing separator.
fn folder(file: &str) -> &str {
    &file[..file.rfind(['/', '\\']).map_or(0, |at| at + 1)]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_panic_is_kept_with_its_place() {
        keep_quiet(&[]);
        let line = line!() + 1;
        let defect = contain(|| panic!("planned {}", 1)).unwrap_err();
        assert_eq!((defect.message(), defect.place()), ("planned 1", &*format!("{}:{line}", plain(file!()))));
        assert_eq!(contain(|| 7), Ok(7));
    }

    #[test]
    fn a_panic_on_another_thread_keeps_its_place() {
        keep_quiet(&[]);
        let other = std::thread::spawn(|| contain(|| panic!("planned elsewhere")).unwrap_err()).join().unwrap();
        assert!(other.place().contains("defect.rs"), "{other}");
        assert_eq!(contain(|| resume(other.clone())).map(drop), Err(other));
    }
}
