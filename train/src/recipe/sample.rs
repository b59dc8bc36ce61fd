//! A sample of the baselines as bytes, for the memory: counts as `u32`, numbers as `f32`, all little-endian.

use nbp_env::nbv::{CandidateInput, HARMONICS, NEIGHBOURS, NbvSample, OccupancyInput, SCALES};

/// The bytes of a sample.
pub fn pack(sample: &NbvSample) -> Vec<u8> {
    let mut out = Vec::new();
    let count = |out: &mut Vec<u8>, count: usize| out.extend((count as u32).to_le_bytes());
    let numbers = |out: &mut Vec<u8>, numbers: &[f32]| out.extend(numbers.iter().flat_map(|x| x.to_le_bytes()));
    count(&mut out, sample.occupancy.len());
    for (input, solid) in sample.occupancy.iter().zip(&sample.solid) {
        count(&mut out, input.cloud.len());
        numbers(&mut out, input.cloud.as_flattened());
        count(&mut out, input.queries.len());
        numbers(&mut out, input.queries.as_flattened());
        numbers(&mut out, input.offsets.as_flattened().as_flattened().as_flattened());
        numbers(&mut out, input.harmonics.as_flattened());
        numbers(&mut out, solid);
    }
    count(&mut out, sample.candidates.len());
    for (input, gain) in sample.candidates.iter().zip(&sample.gains) {
        count(&mut out, input.points.len());
        numbers(&mut out, input.points.as_flattened());
        numbers(&mut out, input.harmonics.as_flattened());
        numbers(&mut out, input.directions.as_flattened());
        numbers(&mut out, &input.weights);
        numbers(&mut out, &[input.mass, *gain]);
    }
    out
}

/// What is left to read.
struct Reader<'a>(&'a [u8]);

impl Reader<'_> {
    fn count(&mut self) -> Option<usize> {
        let (head, tail) = self.0.split_first_chunk::<4>()?;
        self.0 = tail;
        Some(u32::from_le_bytes(*head) as usize)
    }

    /// So many rows of `N` numbers, no more than there are bytes for.
    fn rows<const N: usize>(&mut self, count: usize) -> Option<Vec<[f32; N]>> {
        let (head, tail) = self.0.split_at_checked(count.checked_mul(4 * N)?)?;
        self.0 = tail;
        let numbers: Vec<f32> = head.as_chunks::<4>().0.iter().map(|bytes| f32::from_le_bytes(*bytes)).collect();
        Some(numbers.as_chunks::<N>().0.to_vec())
    }

    fn numbers(&mut self, count: usize) -> Option<Vec<f32>> {
        Some(self.rows::<1>(count)?.into_flattened())
    }
}

/// The sample of some bytes; `None` if they are none.
pub fn unpack(bytes: &[u8]) -> Option<NbvSample> {
    let (mut rest, mut sample) = (Reader(bytes), NbvSample::default());
    for _ in 0..rest.count()? {
        let points = rest.count()?;
        let cloud = rest.rows(points)?;
        let queries = rest.count()?;
        sample.occupancy.push(OccupancyInput {
            cloud,
            queries: rest.rows(queries)?,
            offsets: {
                let flat = rest.rows::<3>(queries.checked_mul(SCALES * NEIGHBOURS)?)?;
                flat.as_chunks::<NEIGHBOURS>().0.as_chunks::<SCALES>().0.to_vec()
            },
            harmonics: rest.rows::<HARMONICS>(queries)?,
        });
        sample.solid.push(rest.numbers(queries)?);
    }
    for _ in 0..rest.count()? {
        let points = rest.count()?;
        let (places, harmonics) = (rest.rows(points)?, rest.rows(points)?);
        let (directions, weights) = (rest.rows(points)?, rest.numbers(points)?);
        let [mass, gain] = *rest.rows::<2>(1)?.first()?;
        sample.candidates.push(CandidateInput { points: places, harmonics, directions, weights, mass });
        sample.gains.push(gain);
    }
    rest.0.is_empty().then_some(sample)
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use proptest::prelude::*;

    /// A sample of so many cells and candidates with numbers of its own.
    pub(crate) fn sample(cells: usize, candidates: usize) -> NbvSample {
        let mut at = 0.1f32;
        let mut next = || {
            at = (at * 17.31 + 0.37).fract();
            at - 0.5
        };
        let mut sample = NbvSample::default();
        for cell in 0..cells {
            let queries = 4 + cell;
            sample.occupancy.push(OccupancyInput {
                cloud: (0..70).map(|_| [(); 3].map(|()| next())).collect(),
                queries: (0..queries).map(|_| [(); 3].map(|()| next())).collect(),
                offsets: (0..queries).map(|_| [(); 3].map(|()| [(); 16].map(|()| [(); 3].map(|()| next())))).collect(),
                harmonics: (0..queries).map(|_| [(); HARMONICS].map(|()| next())).collect(),
            });
            sample.solid.push((0..queries).map(|n| (n % 2) as f32).collect());
        }
        for candidate in 0..candidates {
            let points = 3 * candidate;
            sample.candidates.push(CandidateInput {
                points: (0..points).map(|_| [(); 4].map(|()| next())).collect(),
                harmonics: (0..points).map(|_| [(); HARMONICS].map(|()| next())).collect(),
                directions: (0..points).map(|_| [0.6, 0.0, 0.8]).collect(),
                weights: vec![0.1; points],
                mass: 5.0,
            });
            sample.gains.push(candidate as f32);
        }
        sample
    }

    #[test]
    fn samples_come_back_and_damage_is_seen() {
        for whole in [NbvSample::default(), sample(2, 0), sample(0, 3), sample(3, 5)] {
            let bytes = pack(&whole);
            assert_eq!(unpack(&bytes), Some(whole));
            assert_eq!(unpack(&bytes[..bytes.len() - 1]), None);
            assert_eq!(unpack(&[&bytes[..], &[0]].concat()), None);
        }
        assert_eq!(unpack(&[255; 12]), None, "a count beyond the file");
    }

    proptest! {
        #[test]
        fn unpacking_never_panics(bytes in prop::collection::vec(any::<u8>(), 0..200)) {
            let _ = unpack(&bytes);
        }
    }
}
