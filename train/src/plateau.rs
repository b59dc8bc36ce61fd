//! Learning-rate decay on a plateau of the validation loss, and early stopping.

use serde::{Deserialize, Serialize};

/// What the last observation means.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Verdict {
    /// The best so far.
    Better,
    /// Not better.
    Wait,
    /// Not better for so long that training should end.
    Stop,
}

/// The schedule's state; part of a checkpoint.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Plateau {
    /// Present learning rate.
    pub lr: f64,
    /// Best loss so far; `None` before the first.
    pub best: Option<f64>,
    since_best: usize,
    since_decay: usize,
}

/// Decays stop here, relative to nothing: a smaller rate no longer moves f32 weights.
const LOWEST_RATE: f64 = 1e-8;

impl Plateau {
    /// Starts with a learning rate.
    pub fn new(lr: f64) -> Self {
        Self { lr, best: None, since_best: 0, since_decay: 0 }
    }

    /// Takes in a validation loss: more than `patience` in a row that are not better multiply the rate by `factor`,
    /// `stop_after` (if not 0) end the training.
    pub fn observe(&mut self, loss: f64, factor: f64, patience: usize, stop_after: usize) -> Verdict {
        if self.best.is_none_or(|best| loss < best) {
            *self = Self { lr: self.lr, best: Some(loss), since_best: 0, since_decay: 0 };
            return Verdict::Better;
        }
        self.since_best += 1;
        self.since_decay += 1;
        if self.since_decay > patience {
            self.lr = (self.lr * factor).max(LOWEST_RATE.min(self.lr));
            self.since_decay = 0;
        }
        if stop_after > 0 && self.since_best >= stop_after { Verdict::Stop } else { Verdict::Wait }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn decays_after_patience_and_stops_at_last() {
        let mut plateau = Plateau::new(1.0);
        let mut observe = |loss| (plateau.observe(loss, 0.5, 1, 5), plateau.lr);
        assert_eq!(observe(2.0), (Verdict::Better, 1.0));
        assert_eq!(observe(1.0), (Verdict::Better, 1.0));
        assert_eq!(observe(1.0), (Verdict::Wait, 1.0));
        assert_eq!(observe(1.5), (Verdict::Wait, 0.5));
        assert_eq!(observe(0.9), (Verdict::Better, 0.5));
        let last = (0..5).map(|_| observe(1.0)).last().unwrap();
        assert_eq!(last, (Verdict::Stop, 0.125));
    }
}
