//! A step of AdamW in one pass over memory, where Burn makes a dozen on one thread.

use pulp::{Arch, Simd, WithSimd};
use rayon::prelude::*;

/// What all numbers of a tensor have in common in one step.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Rule {
    pub(crate) lr: f64,
    /// Decay of the two moments.
    pub(crate) betas: [f32; 2],
    /// Added to the root of the second moment.
    pub(crate) epsilon: f32,
    /// Decoupled decay of the weights.
    pub(crate) weight_decay: f32,
    /// This step's number, from 1.
    pub(crate) time: i32,
}

/// Numbers that make a task.
const TASK: usize = 1 << 14;

/// Moves weights and moments, the weights from `before` if they have another place. Every number is computed as Burn's
/// chain of operations does, to the same bits.
pub(super) fn step(
    rule: Rule,
    weights: &mut [f32],
    before: Option<&[f32]>,
    gradient: &[f32],
    first: &mut [f32],
    second: &mut [f32],
) {
    let [beta_1, beta_2] = rule.betas;
    let by = Factors {
        betas: rule.betas,
        fresh: [1.0 - beta_1, 1.0 - beta_2],
        corrections: [1.0 - beta_1.powi(rule.time), 1.0 - beta_2.powi(rule.time)],
        epsilon: rule.epsilon,
        keep: (1.0 - rule.lr * f64::from(rule.weight_decay)) as f32,
        lr: rule.lr as f32,
    };
    let arch = Arch::new();
    let moments = first.par_chunks_mut(TASK).zip(second.par_chunks_mut(TASK));
    let tasks = weights.par_chunks_mut(TASK).zip(gradient.par_chunks(TASK)).zip(moments).enumerate();
    tasks.for_each(|(task, ((weights, gradient), (first, second)))| {
        if let Some(before) = before {
            weights.copy_from_slice(&before[task * TASK..][..weights.len()]);
        }
        arch.dispatch(Piece { by, weights, gradient, first, second });
    });
}

#[derive(Clone, Copy)]
struct Factors {
    betas: [f32; 2],
    /// Share of the newest gradient in each moment.
    fresh: [f32; 2],
    /// Of moments that began at zero.
    corrections: [f32; 2],
    epsilon: f32,
    /// What the decay leaves of a weight.
    keep: f32,
    lr: f32,
}

struct Piece<'a> {
    by: Factors,
    weights: &'a mut [f32],
    gradient: &'a [f32],
    first: &'a mut [f32],
    second: &'a mut [f32],
}

impl WithSimd for Piece<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        let by = self.by;
        let moments = self.first.iter_mut().zip(self.second);
        for ((weight, &g), (first, second)) in self.weights.iter_mut().zip(self.gradient).zip(moments) {
            *first = *first * by.betas[0] + g * by.fresh[0];
            *second = *second * by.betas[1] + g * g * by.fresh[1];
            let delta = (*first / by.corrections[0]) / ((*second / by.corrections[1]).sqrt() + by.epsilon);
            *weight = *weight * by.keep - delta * by.lr;
        }
    }
}
