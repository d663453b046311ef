//! Session slots: the number of sessions, in all and by client, and whether new ones are accepted.

use std::collections::HashMap;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use tokio::sync::watch;
use tokio::time::Instant;

/// State of the server: running or shutting down.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Phase {
    /// Accepts clients.
    Open,
    /// Accepts no clients; running sessions end at this deadline.
    Draining(Instant),
}

/// Reason why a client got no slot.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Refusal {
    Full { places: usize },
    ClientLimit { places: usize },
    Draining,
}

#[derive(Debug, Default)]
struct Taken {
    all: usize,
    /// Slots by client; every entry is at least 1.
    by_client: HashMap<String, usize>,
    is_closed: bool,
}

/// Slots of a server.
#[derive(Debug)]
pub(crate) struct Hub {
    most: usize,
    per_client: usize,
    taken: Mutex<Taken>,
    /// Copy of `taken.all`, for waiting until it is 0.
    count: watch::Sender<usize>,
    phase: watch::Sender<Phase>,
}

/// A slot, freed on drop.
#[derive(Debug)]
pub(crate) struct Place {
    hub: Arc<Hub>,
    client: String,
}

impl Hub {
    pub(crate) fn new(most: usize, per_client: usize) -> Arc<Self> {
        let (count, phase) = (watch::Sender::new(0), watch::Sender::new(Phase::Open));
        Arc::new(Self { most, per_client, taken: Mutex::default(), count, phase })
    }

    fn taken(&self) -> MutexGuard<'_, Taken> {
        self.taken.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Takes a slot. The limits are checked under the lock that takes it, so two clients never get the last
    /// one.
    pub(crate) fn take(self: &Arc<Self>, client: &str) -> Result<Place, Refusal> {
        let mut taken = self.taken();
        if taken.is_closed {
            return Err(Refusal::Draining);
        }
        if taken.all >= self.most {
            return Err(Refusal::Full { places: self.most });
        }
        let of_client = taken.by_client.get(client).copied().unwrap_or(0);
        if of_client >= self.per_client {
            return Err(Refusal::ClientLimit { places: self.per_client });
        }
        taken.by_client.insert(client.to_owned(), of_client + 1);
        taken.all += 1;
        self.count.send_replace(taken.all);
        Ok(Place { hub: Arc::clone(self), client: client.to_owned() })
    }

    /// Stops accepting clients; running sessions end at `deadline`.
    pub(crate) fn drain(&self, deadline: Instant) {
        self.taken().is_closed = true;
        self.phase.send_replace(Phase::Draining(deadline));
    }

    /// Subscribes to changes of the phase.
    pub(crate) fn phase(&self) -> watch::Receiver<Phase> {
        self.phase.subscribe()
    }

    pub(crate) fn sessions(&self) -> usize {
        *self.count.borrow()
    }

    pub(crate) fn places(&self) -> usize {
        self.most
    }

    /// Waits until all slots are free.
    pub(crate) async fn empty(&self) {
        // `wait_for` fails only without a sender, and this hub owns it.
        let _ = self.count.subscribe().wait_for(|&count| count == 0).await;
    }
}

impl Drop for Place {
    fn drop(&mut self) {
        let mut taken = self.hub.taken();
        taken.all -= 1;
        match taken.by_client.get_mut(&self.client) {
            Some(count) if *count > 1 => *count -= 1,
            _ => {
                taken.by_client.remove(&self.client);
            }
        }
        self.hub.count.send_replace(taken.all);
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Barrier;

    use super::*;

    #[test]
    fn places_are_bounded_in_all_and_by_client_and_come_back() {
        let hub = Hub::new(3, 2);
        let first = hub.take("a").unwrap();
        let _second = hub.take("a").unwrap();
        assert_eq!(hub.take("a").unwrap_err(), Refusal::ClientLimit { places: 2 });
        let _third = hub.take("b").unwrap();
        assert_eq!(hub.take("c").unwrap_err(), Refusal::Full { places: 3 });
        drop(first);
        let fourth = hub.take("a").unwrap();
        assert_eq!(hub.sessions(), 3);
        drop(fourth);
        assert_eq!(hub.sessions(), 2);
    }

    #[test]
    fn a_client_that_was_refused_or_left_leaves_nothing_behind() {
        let hub = Hub::new(1, 1);
        let place = hub.take("a").unwrap();
        assert!(hub.take("b").is_err() && hub.take("a").is_err());
        assert_eq!(hub.taken().by_client.len(), 1);
        drop(place);
        assert!(hub.taken().by_client.is_empty());
    }

    #[test]
    fn threads_that_ask_at_once_never_get_more_places_than_there_are() {
        const THREADS: usize = 8;
        for _ in 0..200 {
            let (hub, barrier) = (Hub::new(3, 2), Barrier::new(THREADS));
            let ask = |client: usize| {
                barrier.wait();
                hub.take(["a", "b"][client % 2]).ok()
            };
            let got: Vec<_> = std::thread::scope(|scope| {
                let asking: Vec<_> = (0..THREADS).map(|client| scope.spawn(move || ask(client))).collect();
                asking.into_iter().filter_map(|thread| thread.join().unwrap()).collect()
            });
            assert_eq!((got.len(), hub.sessions()), (3, 3));
            drop(got);
            assert_eq!(hub.sessions(), 0);
        }
    }

    #[test]
    fn a_hub_that_drains_takes_nobody() {
        let hub = Hub::new(2, 2);
        let place = hub.take("a").unwrap();
        let end = Instant::now();
        hub.drain(end);
        assert_eq!(hub.take("b").unwrap_err(), Refusal::Draining);
        assert_eq!(*hub.phase().borrow(), Phase::Draining(end));
        drop(place);
        assert_eq!(hub.sessions(), 0);
    }
}
