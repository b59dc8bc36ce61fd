//! Episodes side by side, whose predictions of a round go through the network in one call.
//!
//! Each episode asks as if it were alone. Once all that are under way wait for an answer, the one that asked last asks the
//! network for all of them, in the order of the episodes: who meets in a round does not depend on how fast threads are.

use nbp_env::{EncoderInput, PredictError, Prediction, Predictor, parallel};
use std::collections::BTreeMap;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::thread::Builder;

/// Runs `job` for every item, `batch` at a time, with a predictor of its own each; answers come in the order of the items.
/// As many of them compute at once as the pool has threads. A batch of one or none lets each job ask the network itself.
///
/// # Errors
/// The first failed job in order; jobs that were under way finish, others are not begun.
pub fn try_map<T: Sync, R: Send, E: Send>(
    items: &[T],
    batch: usize,
    predictor: &Arc<dyn Predictor>,
    job: impl Fn(&T, Arc<dyn Predictor>) -> Result<R, E> + Sync,
) -> Result<Vec<R>, E> {
    let seats = batch.min(items.len());
    if seats <= 1 {
        return parallel::try_map(items, |item| job(item, Arc::clone(predictor)));
    }
    let state = State { seated: seats, free: rayon::current_num_threads(), ..State::default() };
    let rounds = Arc::new(Rounds { network: Arc::clone(predictor), state: Mutex::new(state), changed: Condvar::new() });
    let (next, failed) = (AtomicUsize::new(0), AtomicBool::new(false));
    let results = Mutex::new(Vec::with_capacity(items.len()));
    let work = || {
        let _place = Place::take(&rounds);
        while !failed.load(Ordering::Relaxed) {
            let number = next.fetch_add(1, Ordering::Relaxed);
            let Some(item) = items.get(number) else { break };
            let result = job(item, Arc::new(Seat { number, rounds: Arc::clone(&rounds) }));
            failed.fetch_or(result.is_err(), Ordering::Relaxed);
            results.lock().unwrap_or_else(PoisonError::into_inner).push((number, result));
        }
    };
    std::thread::scope(|scope| {
        let begun = (0..seats).filter(|_| Builder::new().spawn_scoped(scope, work).is_ok()).count();
        // Nobody waits for threads that the system refuses; without any, this one does all.
        rounds.leave(seats - begun.max(1));
        if begun == 0 {
            work();
        }
    });
    let mut results = results.into_inner().unwrap_or_else(PoisonError::into_inner);
    results.sort_by_key(|(number, _)| *number);
    results.into_iter().map(|(_, result)| result).collect()
}

#[derive(Default)]
struct State {
    /// Threads that have or may take an episode.
    seated: usize,
    /// How many more of them may compute now.
    free: usize,
    /// What episodes ask.
    asked: BTreeMap<usize, Vec<EncoderInput>>,
    /// What they have not fetched yet.
    answers: BTreeMap<usize, Answer>,
}

type Answer = Result<Vec<Prediction>, PredictError>;

struct Rounds {
    network: Arc<dyn Predictor>,
    state: Mutex<State>,
    changed: Condvar,
}

impl Rounds {
    fn lock(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// So many seats will not be taken again.
    fn leave(&self, seats: usize) {
        let mut state = self.lock();
        state.seated -= seats;
        self.ask_when_all_wait(state);
    }

    /// Asks the network if everybody waits for it.
    fn ask_when_all_wait(&self, mut state: MutexGuard<'_, State>) {
        self.changed.notify_all();
        if state.asked.is_empty() || state.asked.len() < state.seated {
            return;
        }
        let asked = std::mem::take(&mut state.asked);
        drop(state);
        let counts: Vec<(usize, usize)> = asked.iter().map(|(&number, inputs)| (number, inputs.len())).collect();
        let inputs: Vec<EncoderInput> = asked.into_values().flatten().collect();
        // Nobody else is awake: a panic here would leave them waiting.
        let answer = catch_unwind(AssertUnwindSafe(|| self.network.predict(&inputs)))
            .unwrap_or_else(|_| Err(PredictError::Backend("the network panicked; what it said is above".into())));
        let answers = share(answer, &counts);
        self.lock().answers.extend(answers);
        self.changed.notify_all();
    }

    /// Waits until `ready` finds something, and for leave to compute.
    fn wait<R>(&self, ready: impl Fn(&mut State) -> Option<R>) -> R {
        let mut state = self.lock();
        loop {
            if state.free > 0
                && let Some(found) = ready(&mut state)
            {
                state.free -= 1;
                return found;
            }
            state = self.changed.wait(state).unwrap_or_else(PoisonError::into_inner);
        }
    }
}

/// Everybody's part of an answer; of an error, the first gets the cause and the others its words.
fn share(answer: Answer, counts: &[(usize, usize)]) -> Vec<(usize, Answer)> {
    match answer {
        Ok(predictions) => {
            let mut rest = predictions.into_iter();
            counts.iter().map(|&(number, count)| (number, Ok(rest.by_ref().take(count).collect()))).collect()
        }
        Err(error) => {
            let words = error.to_string();
            let mut cause = Some(error);
            let mut own = || cause.take().unwrap_or_else(|| PredictError::Backend(words.clone()));
            counts.iter().map(|&(number, _)| (number, Err(own()))).collect()
        }
    }
}

/// A thread's place among those that compute; it is given back when the thread ends, however it ends.
struct Place<'a>(&'a Rounds);

impl<'a> Place<'a> {
    fn take(rounds: &'a Rounds) -> Self {
        rounds.wait(|_| Some(()));
        Self(rounds)
    }
}

impl Drop for Place<'_> {
    fn drop(&mut self) {
        self.0.lock().free += 1;
        self.0.leave(1);
    }
}

/// What an episode takes for the network.
struct Seat {
    number: usize,
    rounds: Arc<Rounds>,
}

impl Predictor for Seat {
    fn predict(&self, inputs: &[EncoderInput]) -> Answer {
        let mut state = self.rounds.lock();
        state.free += 1;
        state.asked.insert(self.number, inputs.to_vec());
        self.rounds.ask_when_all_wait(state);
        self.rounds.wait(|state| state.answers.remove(&self.number))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nbp_env::window::{Window, WindowSize};
    use nbp_env::{ObstacleMap, ValueMap};

    /// Answers with the input's first count, and remembers who was asked together.
    #[derive(Default)]
    struct Echo(Mutex<Vec<Vec<u16>>>);

    impl Predictor for Echo {
        fn predict(&self, inputs: &[EncoderInput]) -> Answer {
            let firsts: Vec<u16> = inputs.iter().map(|input| input.counts[0]).collect();
            self.0.lock().unwrap().push(firsts.clone());
            assert!(!firsts.contains(&666), "a test panics");
            if firsts.contains(&13) {
                return Err(PredictError::NonFinite("value"));
            }
            let answer = |first| Prediction {
                value: ValueMap { size: 0, gain: vec![f32::from(first)] },
                obstacle: ObstacleMap { size: 0, probability: Vec::new() },
            };
            Ok(firsts.into_iter().map(answer).collect())
        }
    }

    fn input(first: u16) -> EncoderInput {
        let window = Window { size: WindowSize { pixels: 1, metres: 1.0 }, centre: [0, 0], height: 0.0 };
        EncoderInput { window, channels: 1, counts: vec![first] }
    }

    type Asked = Vec<Vec<u16>>;

    /// Jobs that ask `questions[job]` times, `100 · job + n`.
    fn run(questions: &[u16], batch: usize, threads: usize) -> (Result<Vec<f32>, PredictError>, Asked) {
        let echo = Arc::new(Echo::default());
        let network: Arc<dyn Predictor> = echo.clone();
        let jobs: Vec<(u16, u16)> = (0..).zip(questions.iter().copied()).collect();
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        let answers = pool.install(|| {
            try_map(&jobs, batch, &network, |&(job, questions), predictor| {
                (0..questions)
                    .try_fold(0.0, |sum, n| Ok(sum + predictor.predict(&[input(100 * job + n)])?[0].value.gain[0]))
            })
        });
        let asked = std::mem::take(&mut *echo.0.lock().unwrap());
        (answers, asked)
    }

    #[test]
    fn who_meets_in_a_round_does_not_depend_on_threads() {
        let questions = [2, 0, 3, 1, 4, 1];
        let (alone, one_by_one) = run(&questions, 1, 2);
        assert!(one_by_one.iter().all(|round| round.len() == 1));
        for (batch, threads) in [(2, 1), (3, 1), (3, 4), (50, 2)] {
            let (answers, asked) = run(&questions, batch, threads);
            assert_eq!(answers.unwrap(), *alone.as_ref().unwrap(), "batch {batch}, {threads} threads");
            assert!(asked.iter().all(|round| round.len() <= batch && round.is_sorted()), "{asked:?}");
            assert_eq!(asked, run(&questions, batch, 7).1);
        }
        assert_eq!(run(&questions, 50, 2).1[0], [0, 200, 300, 400, 500]);
        assert!(run(&[], 4, 2).0.unwrap().is_empty());
    }

    #[test]
    fn failures_end_all_rounds() {
        let mut questions = vec![1; 9];
        questions[0] = 20;
        let error = run(&questions, 4, 2).0.unwrap_err();
        assert!(error.to_string().contains("value map"), "{error}");
        questions = vec![1; 9];
        questions[6] = 67;
        let error = run(&questions, 3, 2).0.unwrap_err();
        assert!(error.to_string().contains("panicked"), "{error}");
    }
}
