//! Where skills go when those of a deployment change while the loop runs.

/// The place of each skill before, and after, a change.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Moves {
    from: Vec<Option<usize>>,
    to: Vec<Option<usize>>,
}

impl Moves {
    /// From `before` to `after`, where each skill says whether it goes on as it is or is new.
    pub(crate) fn between<'a>(
        before: impl Iterator<Item = &'a str>,
        after: impl Iterator<Item = (&'a str, bool)>,
    ) -> Self {
        let before: Vec<&str> = before.collect();
        let place = |name: &str| before.iter().position(|old| *old == name);
        let from: Vec<_> = after.map(|(name, is_new)| place(name).filter(|_| !is_new)).collect();
        let mut to = vec![None; before.len()];
        for (new, old) in from.iter().enumerate() {
            if let Some(old) = old {
                to[*old] = Some(new);
            }
        }
        Self { from, to }
    }

    /// Where the skill of a former place stands now; nowhere when it is gone or another one.
    pub(crate) fn to(&self, before: usize) -> Option<usize> {
        self.to.get(before).copied().flatten()
    }

    /// What belonged to each skill that goes on, and `fresh` for the others; then what belonged to those
    /// that are gone.
    pub(crate) fn carry<T>(&self, before: Vec<T>, mut fresh: impl FnMut(usize) -> T) -> (Vec<T>, Vec<T>) {
        let mut before: Vec<Option<T>> = before.into_iter().map(Some).collect();
        let mut carried = |(new, old): (usize, &Option<usize>)| {
            old.and_then(|old| before.get_mut(old)?.take()).unwrap_or_else(|| fresh(new))
        };
        let after = self.from.iter().enumerate().map(&mut carried).collect();
        (after, before.into_iter().flatten().collect())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_belongs_to_a_skill_goes_with_it() {
        let after = [("trot", true), ("ascend", false), ("walk", true)];
        let moves = Moves::between(["walk", "ascend", "descend"].into_iter(), after.into_iter());
        assert_eq!([0, 1, 2, 3].map(|old| moves.to(old)), [None, Some(1), None, None]);
        let (now, gone) = moves.carry(vec![10, 11, 12], |new| 100 + new);
        assert_eq!((now, gone), (vec![100, 11, 102], vec![10, 12]), "a replaced skill begins anew");
    }
}
