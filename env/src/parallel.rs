//! Many independent jobs on plain threads, answers in the order of the jobs.
//!
//! Not tasks of the thread pool: a network computes in that pool, and a task that waits for it there would take up other
//! episodes meanwhile, one inside the other.

use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::{Mutex, PoisonError};

/// Runs `job` for every item on as many threads as the pool has, and returns the answers in order.
///
/// # Errors
/// The first failed job in order; jobs that were under way finish, others are not begun.
pub fn try_map<T: Sync, R: Send, E: Send>(items: &[T], job: impl Fn(&T) -> Result<R, E> + Sync) -> Result<Vec<R>, E> {
    let (next, failed) = (AtomicUsize::new(0), AtomicBool::new(false));
    let results = Mutex::new(Vec::with_capacity(items.len()));
    let work = || {
        while !failed.load(Ordering::Relaxed) {
            let index = next.fetch_add(1, Ordering::Relaxed);
            let Some(item) = items.get(index) else { break };
            let result = job(item);
            failed.fetch_or(result.is_err(), Ordering::Relaxed);
            results.lock().unwrap_or_else(PoisonError::into_inner).push((index, result));
        }
    };
    let threads = rayon::current_num_threads().min(items.len());
    std::thread::scope(|scope| (0..threads).for_each(|_| drop(scope.spawn(work))));
    let mut results = results.into_inner().unwrap_or_else(PoisonError::into_inner);
    results.sort_by_key(|(index, _)| *index);
    results.into_iter().map(|(_, result)| result).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn answers_come_in_order_and_the_first_failure_wins() {
        let items: Vec<usize> = (0..100).collect();
        let doubled = try_map(&items, |&n| Ok::<_, usize>(2 * n)).unwrap();
        assert_eq!(doubled, items.iter().map(|n| 2 * n).collect::<Vec<_>>());
        let failed = try_map(&items, |&n| if n == 0 || n == 70 { Err(n) } else { Ok(n) });
        assert_eq!(failed.unwrap_err(), 0);
        assert!(try_map(&[] as &[usize], |&n| Err::<(), _>(n)).unwrap().is_empty());
    }
}
