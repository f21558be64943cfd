//! Which iterations of a render are in its sums.

use serde::{Deserialize, Serialize};

/// A set of iterations by their numbers, which count from 0. In memory and in a file it is a list of runs, so that a render of any
/// length takes little space.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(try_from = "Vec<[u32; 3]>", into = "Vec<[u32; 3]>")]
pub struct Iterations(
    /// In ascending order; each run ends before the next one begins. Equal sets have equal runs, see [`Iterations::push`].
    Vec<Run>,
);

/// `count` iterations, the first one of which is `first`, `step` apart. A single iteration has the step 1.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Run {
    first: u32,
    count: u32,
    step: u32,
}

impl Run {
    fn last(&self) -> u32 {
        self.first + (self.count - 1) * self.step
    }

    fn has(&self, number: u32) -> bool {
        (self.first..=self.last()).contains(&number) && (number - self.first).is_multiple_of(self.step)
    }

    fn iter(self) -> impl Iterator<Item = u32> {
        (0..self.count).map(move |k| self.first + k * self.step)
    }
}

impl Iterations {
    /// Number of iterations in the set.
    pub fn len(&self) -> u32 {
        self.0.iter().map(|run| run.count).sum()
    }

    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// All iterations in ascending order.
    pub fn iter(&self) -> impl Iterator<Item = u32> {
        self.0.iter().flat_map(|run| run.iter())
    }

    /// The first iteration.
    pub fn first(&self) -> Option<u32> {
        self.0.first().map(|run| run.first)
    }

    /// The iteration after the last one; 0 if the set is empty.
    pub fn end(&self) -> u32 {
        self.0.last().map_or(0, |run| run.last() + 1)
    }

    /// Adds an iteration, which the set does not have.
    pub fn add(&mut self, number: u32) {
        if number >= self.end() {
            self.push(number);
        } else {
            *self = self.with(&Iterations(vec![Run { first: number, count: 1, step: 1 }]));
        }
    }

    /// Adds an iteration after the last one: to the last run if it continues this run.
    fn push(&mut self, number: u32) {
        match self.0.last_mut() {
            Some(run) if run.count == 1 => (run.count, run.step) = (2, number - run.first),
            Some(run) if run.last() + run.step == number => run.count += 1,
            _ => self.0.push(Run { first: number, count: 1, step: 1 }),
        }
    }

    /// Adds a run after the last iteration.
    fn push_run(&mut self, run: Run) {
        // Whatever run was the last one: after three iterations the last run has the step of `run`.
        run.iter().take(3).for_each(|number| self.push(number));
        if let Some(last) = self.0.last_mut() {
            last.count += run.count.saturating_sub(3);
        }
    }

    fn has(&self, number: u32) -> bool {
        let after = self.0.partition_point(|run| run.first <= number);
        after > 0 && self.0[after - 1].has(number)
    }

    /// An iteration that both sets have, if there is one.
    pub fn common(&self, other: &Iterations) -> Option<u32> {
        let (few, many) = if self.len() <= other.len() { (self, other) } else { (other, self) };
        let (begin, end) = (many.first()?, many.end());
        let overlaps = |run: &&Run| run.first < end && run.last() >= begin;
        few.0.iter().filter(overlaps).flat_map(|run| run.iter()).find(|&number| many.has(number))
    }

    /// The iterations of both sets, which have none in common.
    pub fn with(&self, other: &Iterations) -> Iterations {
        let (a, b) = if self.first() <= other.first() { (self, other) } else { (other, self) };
        let mut all = a.clone();
        if b.first().is_none_or(|first| first >= a.end()) {
            b.0.iter().for_each(|&run| all.push_run(run));
            return all;
        }
        all.0.clear();
        let (mut a, mut b) = (a.iter().peekable(), b.iter().peekable());
        loop {
            let a_is_next = match (a.peek(), b.peek()) {
                (Some(x), Some(y)) => x < y,
                (x, _) => x.is_some(),
            };
            match if a_is_next { a.next() } else { b.next() } {
                Some(number) => all.push(number),
                None => return all,
            }
        }
    }

    /// The first missing iteration before the last one of the set.
    pub fn gap(&self) -> Option<u32> {
        let mut expected = 0;
        for run in &self.0 {
            if run.first != expected {
                return Some(expected);
            }
            if run.step > 1 {
                return Some(expected + 1);
            }
            expected += run.count;
        }
        None
    }
}

impl From<Iterations> for Vec<[u32; 3]> {
    fn from(set: Iterations) -> Vec<[u32; 3]> {
        set.0.into_iter().map(|Run { first, count, step }| [first, count, step]).collect()
    }
}

impl TryFrom<Vec<[u32; 3]>> for Iterations {
    type Error = &'static str;

    fn try_from(runs: Vec<[u32; 3]>) -> Result<Iterations, &'static str> {
        let mut all = Iterations::default();
        for [first, count, step] in runs {
            let end = u64::from(first) + u64::from(count) * u64::from(step);
            if count == 0 || step == 0 || end >= u64::from(u32::MAX) {
                return Err("iterations must be runs [first, count, step], with count and step above 0");
            }
            if first < all.end() {
                return Err("the runs of iterations are not in ascending order, or an iteration is listed twice");
            }
            all.push_run(Run { first, count, step });
        }
        Ok(all)
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
        for text in ["[[0,0,1]]", "[[0,2,0]]", "[[4294967295,1,1]]", "[[1,2,1],[2,1,1]]", "[[1,2]]"] {
            assert!(serde_json::from_str::<Iterations>(text).is_err(), "{text}");
        }
    }

    #[test]
    fn a_render_may_be_long() {
        let text = "[[0,4000000000,1]]";
        let mut long: Iterations = serde_json::from_str(text).unwrap();
        assert_eq!((long.len(), long.end(), long.gap()), (4_000_000_000, 4_000_000_000, None));
        long.add(4_000_000_000);
        assert_eq!(serde_json::to_string(&long).unwrap(), "[[0,4000000001,1]]");
        let later = set([4_000_000_002, 4_000_000_004]);
        assert_eq!(long.common(&later), None);
        assert_eq!(long.common(&set([7])), Some(7));
        let both = long.with(&later);
        assert_eq!(both, later.with(&long));
        assert_eq!((both.len(), both.gap()), (4_000_000_003, Some(4_000_000_001)));
    }

    #[test]
    fn equal_sets_have_equal_runs() {
        for numbers in [vec![0, 2, 4, 6, 7, 8, 9], vec![3, 4, 6, 8, 10, 13], vec![1, 2, 3, 4, 9, 14, 19, 24, 25]] {
            let whole = set(numbers.iter().copied());
            assert_eq!(whole.iter().collect::<Vec<_>>(), numbers);
            assert_eq!(set(numbers.iter().rev().copied()), whole);
            for at in 0..numbers.len() {
                let (a, b) = (set(numbers[..at].iter().copied()), set(numbers[at..].iter().copied()));
                assert_eq!(a.with(&b), whole, "at {at}");
            }
        }
        let split: Iterations = serde_json::from_str("[[0,2,1],[2,1,1],[3,4,1]]").unwrap();
        assert_eq!(split, set(0..7));
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
