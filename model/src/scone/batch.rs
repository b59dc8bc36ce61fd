//! From what is asked to tensors. Sets of different sizes are filled up to the largest of a batch.

use super::config::{HARMONICS, SCALES};
use super::{Padding, Queries, Views};
use burn::prelude::*;
use nbp_env::PredictError;
use nbp_env::nbv::{CandidateInput, NEIGHBOURS, OccupancyInput, harmonics_at};

/// Whether every query has its neighbours and harmonics, and every cloud a point.
///
/// # Errors
/// Naming what is missing.
pub fn check_occupancy(input: &OccupancyInput) -> Result<(), PredictError> {
    let OccupancyInput { cloud, queries, offsets, harmonics } = input;
    if [offsets.len(), harmonics.len()] != [queries.len(); 2] {
        return Err(misfit(format_args!(
            "{} queries have {} neighbourhoods and {} sets of harmonics",
            queries.len(),
            offsets.len(),
            harmonics.len()
        )));
    }
    match cloud.is_empty() && !queries.is_empty() {
        true => Err(misfit(format_args!("{} queries lie in a cloud without points", queries.len()))),
        false => Ok(()),
    }
}

/// Whether every point has all that belongs to it.
///
/// # Errors
/// Naming what is missing.
pub fn check_candidate(input: &CandidateInput) -> Result<(), PredictError> {
    let CandidateInput { points, harmonics, directions, weights, .. } = input;
    match [harmonics.len(), directions.len(), weights.len()] == [points.len(); 3] {
        true => Ok(()),
        false => Err(misfit(format_args!(
            "{} points have {} sets of harmonics, {} directions and {} weights",
            points.len(),
            harmonics.len(),
            directions.len(),
            weights.len()
        ))),
    }
}

/// The harmonics that coefficients of visibility are of: their pole is `z`, and azimuths count from `x`.
fn basis([x, y, z]: [f32; 3]) -> [f32; HARMONICS] {
    harmonics_at([y, z, x])
}

fn misfit(what: std::fmt::Arguments<'_>) -> PredictError {
    PredictError::Backend(what.to_string())
}

fn tensor<const D: usize>(numbers: Vec<f32>, shape: [usize; D], device: &Device) -> Tensor<D> {
    Tensor::from_data(TensorData::new(numbers, shape), device)
}

/// Clouds, which must have a point each.
///
/// # Shapes
/// `[l, n, 3]`, n as many as the largest has; padding unless all have as many.
pub fn clouds(clouds: &[&[[f32; 3]]], device: &Device) -> (Tensor<3>, Option<Padding>) {
    let counts: Vec<usize> = clouds.iter().map(|cloud| cloud.len()).collect();
    let rows = counts.iter().copied().max().unwrap_or(0);
    let fill = |cloud: &&[[f32; 3]]| {
        let mut numbers = cloud.as_flattened().to_vec();
        numbers.resize(3 * rows, 0.0);
        numbers
    };
    let numbers = clouds.iter().flat_map(fill).collect();
    let padding = counts.iter().any(|&count| count < rows).then(|| Padding::new(&counts, rows, device));
    (tensor(numbers, [clouds.len(), rows, 3], device), padding)
}

/// Queries, each by the row of its cloud, its input and its number in that.
pub fn queries(inputs: &[OccupancyInput], asked: &[(usize, usize, usize)], device: &Device) -> Queries {
    let count = asked.len();
    let rows: Vec<i32> = asked.iter().map(|&(row, ..)| row as i32).collect();
    let points = asked.iter().flat_map(|&(_, input, query)| inputs[input].queries[query]).collect();
    let offsets: [Vec<f32>; SCALES] = std::array::from_fn(|scale| {
        let of = |&(_, input, query): &(usize, usize, usize)| inputs[input].offsets[query][scale].as_flattened();
        asked.iter().flat_map(of).copied().collect()
    });
    let harmonics = asked.iter().flat_map(|&(_, input, query)| inputs[input].harmonics[query]).collect();
    Queries {
        cloud_q: Tensor::from_data(TensorData::new(rows, [count]), device),
        point_q3: tensor(points, [count, 3], device),
        offsets_qn3: offsets.map(|numbers| tensor(numbers, [count, NEIGHBOURS, 3], device)),
        harmonics_qk: tensor(harmonics, [count, HARMONICS], device),
    }
}

/// Candidates, which must have a point each. A visible point counts its weight times the candidate's mass.
pub fn views(candidates: &[&CandidateInput], device: &Device) -> Views {
    let counts: Vec<usize> = candidates.iter().map(|candidate| candidate.points.len()).collect();
    let (b, rows) = (candidates.len(), counts.iter().copied().max().unwrap_or(0));
    let filled = |width: usize, numbers: &dyn Fn(&CandidateInput, &mut Vec<f32>)| {
        let mut all = Vec::with_capacity(b * rows * width);
        for (n, candidate) in candidates.iter().enumerate() {
            numbers(candidate, &mut all);
            all.resize((n + 1) * rows * width, 0.0);
        }
        all
    };
    let points = filled(4, &|candidate, all| all.extend(candidate.points.as_flattened()));
    let harmonics = filled(HARMONICS, &|candidate, all| all.extend(candidate.harmonics.as_flattened()));
    let directions =
        filled(HARMONICS, &|candidate, all| all.extend(candidate.directions.iter().flat_map(|&d| basis(d))));
    let weights =
        filled(1, &|candidate, all| all.extend(candidate.weights.iter().map(|weight| weight * candidate.mass)));
    Views {
        point_bn4: tensor(points, [b, rows, 4], device),
        harmonics_bnk: tensor(harmonics, [b, rows, HARMONICS], device),
        basis_bnk: tensor(directions, [b, rows, HARMONICS], device),
        weight_bn: tensor(weights, [b, rows], device),
        padding: Padding::new(&counts, rows, device),
    }
}
