//! The name that a mistyped word was meant to be.

/// Shortest word for which a name is sought, and the letters that are compared.
const LETTERS: [usize; 2] = [3, 64];

/// The value of the name nearest to a word, ignoring case; `None` if more than a quarter of its letters, and more
/// than one, would have to change. A word may be cut short.
pub fn nearest<'n, T>(word: &str, names: impl IntoIterator<Item = (&'n str, T)>) -> Option<T> {
    let letters = |text: &str| -> Vec<char> {
        text.trim_start_matches('-').chars().flat_map(char::to_lowercase).take(LETTERS[1]).collect()
    };
    let word = letters(word);
    let near = names.into_iter().map(|(name, value)| (edits(&word, &letters(name)), value));
    let near = near.filter(|([start, _], _)| word.len() >= LETTERS[0] && *start <= (word.len() / 4).max(1));
    near.min_by_key(|(edits, _)| *edits).map(|(_, value)| value)
}

/// Letters to insert, leave out, replace or swap with the next one, so that a word becomes the start of a name, and all of
/// it.
fn edits(word: &[char], name: &[char]) -> [usize; 2] {
    let mut rows = [Vec::new(), (0..=name.len()).collect::<Vec<usize>>()];
    for (i, letter) in word.iter().enumerate() {
        let mut row = vec![i + 1];
        for (j, other) in name.iter().enumerate() {
            let replaced = rows[1][j] + usize::from(letter != other);
            let mut least = replaced.min(rows[1][j + 1] + 1).min(row[j] + 1);
            if i > 0 && j > 0 && (*letter, word[i - 1]) == (name[j - 1], *other) {
                least = least.min(rows[0][j - 1] + 1);
            }
            row.push(least);
        }
        rows = [std::mem::take(&mut rows[1]), row];
    }
    [rows[1].iter().copied().min().unwrap_or(0), rows[1][name.len()]]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn mistyped_and_shortened_words_are_recognised_and_others_are_not() {
        let names = [
            "--resume",
            "--normals",
            "--threshold",
            "--threads",
            "--size",
            "liver",
            "Left kidney",
            "build",
            "aorta",
        ];
        for (word, meant) in [
            ("--tresh", Some("--threshold")),
            ("--treads", Some("--threads")),
            ("livr", Some("liver")),
            ("LIVER", Some("liver")),
            ("left kidny", Some("Left kidney")),
            ("bulid", Some("build")),
            ("hart", None),
            ("--s", None),
            ("--channels", None),
            ("--format", None),
        ] {
            assert_eq!(nearest(word, names.map(|name| (name, name))), meant, "{word}");
        }
    }
}
