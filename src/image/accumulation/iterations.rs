//! Which iterations of a render are in its sums.

use serde::{Deserialize, Serialize};

/// Maximum number of iterations in a file: 128 MiB of memory, and two days of iterations of 5 ms.
const MAX_ITERATIONS: u64 = 1 << 25;

/// A set of iterations by their numbers, which count from 0. In a file it is a list of runs: first iteration, number of iterations,
/// step.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(try_from = "Vec<[u32; 3]>", into = "Vec<[u32; 3]>")]
pub struct Iterations(
    /// In ascending order.
    Vec<u32>,
);

impl Iterations {
    /// Number of iterations in the set.
    pub fn len(&self) -> u32 {
        self.0.len() as u32
    }

    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// All iterations in ascending order.
    pub fn iter(&self) -> impl ExactSizeIterator<Item = u32> {
        self.0.iter().copied()
    }

    /// The first iteration.
    pub fn first(&self) -> Option<u32> {
        self.0.first().copied()
    }

    /// The iteration after the last one; 0 if the set is empty.
    pub fn end(&self) -> u32 {
        self.0.last().map_or(0, |last| last + 1)
    }

    /// Adds an iteration, which the set does not have.
    pub fn add(&mut self, number: u32) {
        let at = self.0.partition_point(|&other| other < number);
        self.0.insert(at, number);
    }

    /// An iteration that both sets have, if there is one.
    pub fn common(&self, other: &Iterations) -> Option<u32> {
        self.iter().find(|number| other.0.binary_search(number).is_ok())
    }

    /// The iterations of both sets, which have none in common.
    pub fn with(&self, other: &Iterations) -> Iterations {
        let mut all = [&self.0[..], &other.0].concat();
        all.sort_unstable();
        Iterations(all)
    }

    /// The first missing iteration before the last one of the set.
    pub fn gap(&self) -> Option<u32> {
        let number = self.0.iter().zip(0..).find(|&(&number, at)| number != at)?.1;
        Some(number)
    }
}

impl From<Iterations> for Vec<[u32; 3]> {
    fn from(set: Iterations) -> Vec<[u32; 3]> {
        let mut runs: Vec<[u32; 3]> = vec![];
        for number in set.0 {
            match runs.last_mut() {
                Some([first, count, step]) if *count == 1 => (*count, *step) = (2, number - *first),
                Some([first, count, step]) if *first + *count * *step == number => *count += 1,
                _ => runs.push([number, 1, 1]),
            }
        }
        runs
    }
}

impl TryFrom<Vec<[u32; 3]>> for Iterations {
    type Error = &'static str;

    fn try_from(runs: Vec<[u32; 3]>) -> Result<Iterations, &'static str> {
        let total = runs.iter().map(|run| u64::from(run[1])).sum::<u64>();
        if total > MAX_ITERATIONS {
            return Err("there are too many iterations");
        }
        let mut all = Vec::with_capacity(total as usize);
        for [first, count, step] in runs {
            let last = u64::from(first) + u64::from(count) * u64::from(step);
            if count == 0 || step == 0 || last >= u64::from(u32::MAX) {
                return Err("iterations must be runs [first, count, step], with count and step above 0");
            }
            all.extend((0..count).map(|i| first + i * step));
        }
        all.sort_unstable();
        match all.is_sorted_by(|a, b| a < b) {
            true => Ok(Iterations(all)),
            false => Err("an iteration is listed twice"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn set(numbers: impl IntoIterator<Item = u32>) -> Iterations {
        let mut set = Iterations::default();
        numbers.into_iter().for_each(|number| set.add(number));
        set
    }

    #[test]
    fn sets_survive_a_file() {
        for (numbers, text) in [
            (vec![], "[]"),
            (vec![5], "[[5,1,1]]"),
            ((0..9).collect(), "[[0,9,1]]"),
            (vec![1, 4, 7, 10], "[[1,4,3]]"),
            (vec![0, 1, 2, 7, 9, 11], "[[0,3,1],[7,3,2]]"),
        ] {
            let set = set(numbers);
            assert_eq!(serde_json::to_string(&set).unwrap(), text);
            assert_eq!(serde_json::from_str::<Iterations>(text).unwrap(), set);
        }
        for text in ["[[0,33554433,1]]", "[[0,0,1]]", "[[0,2,0]]", "[[4294967295,1,1]]", "[[1,2,1],[2,1,1]]", "[[1,2]]"]
        {
            assert!(serde_json::from_str::<Iterations>(text).is_err(), "{text}");
        }
    }

    #[test]
    fn unions_and_gaps() {
        let (even, odd) = (set([0, 2, 4]), set([3, 1]));
        assert_eq!((even.common(&odd), even.common(&set([3, 4]))), (None, Some(4)));
        assert_eq!(even.with(&odd), set(0..5));
        assert_eq!((even.gap(), odd.gap(), set(0..5).gap(), set([]).gap()), (Some(1), Some(0), None, None));
        assert_eq!((even.first(), even.end(), set([]).end(), even.len()), (Some(0), 5, 0, 3));
    }
}
