//! Things made on a thread of their own, one ahead of whoever uses them: batches are read, unpacked and augmented while
//! the network learns from the one before.

use std::sync::mpsc::{Receiver, sync_channel};
use std::time::{Duration, Instant};

/// What was made, in the order of the jobs.
#[derive(Debug)]
pub struct Ahead<T> {
    ready: Receiver<T>,
    waited: Duration,
}

impl<T> Ahead<T> {
    /// How long its user waited since the last call.
    pub fn waited(&mut self) -> Duration {
        std::mem::take(&mut self.waited)
    }
}

impl<T> Iterator for Ahead<T> {
    type Item = T;

    fn next(&mut self) -> Option<T> {
        let begun = Instant::now();
        let item = self.ready.recv().ok();
        self.waited += begun.elapsed();
        item
    }
}

/// Runs `work` on what `make` makes of each job. Never more than one thing waits to be used; what is left when `work` ends
/// is not made.
pub fn ahead<J, T: Send, R>(
    jobs: impl Iterator<Item = J> + Send,
    make: impl FnMut(J) -> T + Send,
    work: impl FnOnce(&mut Ahead<T>) -> R,
) -> R {
    // Without room in between, the maker holds what it made until it is taken.
    let (send, ready) = sync_channel(0);
    std::thread::scope(|scope| {
        scope.spawn(move || jobs.map(make).try_for_each(|item| send.send(item)));
        let mut ahead = Ahead { ready, waited: Duration::ZERO };
        work(&mut ahead)
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::atomic::{AtomicUsize, Ordering};

    #[test]
    fn order_is_kept_and_no_more_than_one_is_ahead() {
        let made = AtomicUsize::new(0);
        let make = |n: usize| {
            made.fetch_add(1, Ordering::SeqCst);
            n * n
        };
        ahead(0..50, make, |squares| {
            for n in 0..20 {
                assert_eq!(squares.next(), Some(n * n));
                // The next one, and none after it, may be under way.
                assert!(made.load(Ordering::SeqCst) <= n + 2);
            }
        });
        assert!(made.load(Ordering::SeqCst) <= 21, "made what nobody wanted");
        assert_eq!(ahead(0..3, |n| n, |all| all.collect::<Vec<_>>()), [0, 1, 2]);
    }
}
