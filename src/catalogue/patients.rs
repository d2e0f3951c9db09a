//! Words that tell who the patients of all images are, to mask them wherever a path may tell.
//!
//! They come from Patient's Name, Patient ID and Patient's Birth Date of every image that a survey meets. They are
//! found in any case, and a birth date in the usual ways of writing it. Words of four and more letters are found
//! anywhere, shorter ones only where they stand for themselves (`Kim_CT`, not `skimage`).

use std::collections::BTreeSet;
use std::ops::Range;

use crate::source::dicom::{Secrets, words};

/// Words that are kept; of more, the longest. A few hundred KiB at most.
const MOST_WORDS: usize = 4096;

/// Longest part of a word that is compared, in letters.
const MOST_LETTERS: usize = 64;

/// Shortest word that is found within others.
const WITHIN: usize = 4;

/// Words of patients in the making.
#[derive(Debug, Default)]
pub(super) struct Gathered {
    /// With their length first: the shortest goes when there are too many.
    kept: BTreeSet<(usize, Box<str>)>,
    /// What was noted last: most images of a folder show one patient.
    latest: Option<Secrets>,
    full: bool,
}

/// Digits of the shortest number that tells who a patient is, wherever it stands.
const LEAST_DIGITS: usize = 5;

impl Gathered {
    /// Takes note of whom an image shows.
    pub(super) fn note(&mut self, secrets: &Secrets) {
        if self.latest.as_ref() == Some(secrets) {
            return;
        }
        self.latest = Some(secrets.clone());
        let mut all = Vec::new();
        words(secrets, &mut all);
        // Short numbers count images and series everywhere; beside its own images one is masked all the same.
        let counts = |word: &String| word.len() < LEAST_DIGITS && word.bytes().all(|b| b.is_ascii_digit());
        for word in all.into_iter().filter(|word| !counts(word)) {
            let word: String = folded(&word).take(MOST_LETTERS).collect();
            let entry = (word.chars().count(), word.into_boxed_str());
            let is_short = self.kept.first().is_some_and(|shortest| entry <= *shortest);
            if self.kept.len() >= MOST_WORDS && is_short {
                self.full |= !self.kept.contains(&entry);
            } else if self.kept.insert(entry) && self.kept.len() > MOST_WORDS {
                self.kept.pop_first();
                self.full = true;
            }
        }
    }

    /// The words, ready to be looked for.
    pub(super) fn finish(self) -> PatientWords {
        let mut kept: Vec<Box<str>> = self.kept.into_iter().map(|(_, word)| word).collect();
        kept.sort_unstable();
        PatientWords { kept, full: self.full }
    }
}

/// Words that tell who the patients of a [`Catalogue`](super::Catalogue) are. Not for printing.
#[derive(Default)]
pub struct PatientWords {
    /// In lower case, sorted.
    kept: Vec<Box<str>>,
    full: bool,
}

impl std::fmt::Debug for PatientWords {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{} words", self.kept.len())
    }
}

impl PatientWords {
    /// Most words that are kept; of more, the longest.
    pub const MOST: usize = MOST_WORDS;

    /// Were there more than [`PatientWords::MOST`]?
    pub fn is_full(&self) -> bool {
        self.full
    }

    /// `text` with `mark` in the place of every word, and of every word of `own`, which are found anywhere
    /// however short they are. What `spares` says of the text and the bytes of a word stays.
    ///
    /// Cost: some comparisons a letter with the words that begin like the text there.
    pub fn masked(
        &self,
        text: &str,
        own: &[String],
        mark: &str,
        spares: &dyn Fn(&str, Range<usize>) -> bool,
    ) -> String {
        if self.kept.is_empty() && own.is_empty() {
            return text.to_owned();
        }
        let own: Vec<Vec<char>> =
            own.iter().map(|w| folded(w).collect()).filter(|w: &Vec<_>| !w.is_empty()).collect();
        let mut search = Search { words: self, own, letters: Letter::all(text), masked: 0 };
        let mut out = String::with_capacity(text.len());
        let mut at = 0;
        while let Some(letter) = search.letters.get(at) {
            let start = letter.offset;
            let end = search.match_at(at).filter(|end| !spares(text, start..search.offset(*end, text)));
            match end {
                Some(end) => {
                    out.push_str(mark);
                    at = end;
                    search.masked = end;
                }
                None => {
                    at = search.next_start(at);
                    out.push_str(text.get(start..search.offset(at, text)).unwrap_or_default());
                }
            }
        }
        out
    }
}

/// A letter of a text in lower case; some become two.
struct Letter {
    letter: char,
    /// Byte of the text.
    offset: usize,
    /// The first that its letter of the text became?
    starts: bool,
}

impl Letter {
    fn all(text: &str) -> Vec<Self> {
        let lower = |(offset, c): (usize, char)| {
            c.to_lowercase().enumerate().map(move |(i, letter)| Self { letter, offset, starts: i == 0 })
        };
        text.char_indices().flat_map(lower).collect()
    }
}

fn folded(word: &str) -> impl Iterator<Item = char> + '_ {
    word.chars().flat_map(char::to_lowercase)
}

/// One text that is being searched.
struct Search<'a> {
    words: &'a PatientWords,
    own: Vec<Vec<char>>,
    letters: Vec<Letter>,
    /// Where the last masked word ended.
    masked: usize,
}

impl Search<'_> {
    fn letter(&self, at: usize) -> Option<char> {
        self.letters.get(at).map(|l| l.letter)
    }

    fn offset(&self, at: usize, text: &str) -> usize {
        self.letters.get(at).map_or(text.len(), |l| l.offset)
    }

    /// Where the next letter of the text begins.
    fn next_start(&self, at: usize) -> usize {
        let more = self.letters.iter().skip(at + 1).take_while(|l| !l.starts).count();
        at + 1 + more
    }

    /// The end of the longest word that begins here.
    fn match_at(&self, at: usize) -> Option<usize> {
        let own = self.own.iter().filter_map(|word| self.ends(at, word.iter().copied())).max();
        own.max(self.general(at, true)).max(self.date(at))
    }

    /// The end of the longest word of all patients that begins here; of short ones only if they are looked for.
    fn general(&self, at: usize, short: bool) -> Option<usize> {
        let first = self.letter(at)?;
        let begins = |word: &str| word.chars().next().unwrap_or_default();
        let from = self.words.kept.partition_point(|word| begins(word) < first);
        let alike = self.words.kept.iter().skip(from).take_while(|word| begins(word) == first);
        let stands = |end: &usize| end - at >= WITHIN || (short && self.is_apart(at, *end));
        alike.filter_map(|word| self.ends(at, word.chars())).filter(stands).max()
    }

    /// Where a word ends that begins here.
    fn ends(&self, at: usize, word: impl Iterator<Item = char>) -> Option<usize> {
        let mut end = at;
        for wanted in word {
            if self.letter(end)? != wanted {
                return None;
            }
            end += 1;
        }
        self.letters.get(end).is_none_or(|l| l.starts).then_some(end)
    }

    /// Is there no letter (beside letters) or digit (beside digits) right before and behind, unless it is
    /// part of another word of a patient?
    fn is_apart(&self, at: usize, end: usize) -> bool {
        let joined = |a: Option<char>, b: Option<char>| match (a, b) {
            (Some(a), Some(b)) => {
                (a.is_alphabetic() && b.is_alphabetic()) || (a.is_numeric() && b.is_numeric())
            }
            _ => false,
        };
        let before = at.checked_sub(1).and_then(|before| self.letter(before));
        let free_before = self.masked == at || !joined(before, self.letter(at));
        let last = end.checked_sub(1).and_then(|last| self.letter(last));
        free_before && (!joined(last, self.letter(end)) || self.general(end, false).is_some())
    }

    /// The end of a birth date in another form than year, month, day without signs between them.
    fn date(&self, at: usize) -> Option<usize> {
        let digit = |at: usize| self.letter(at).filter(char::is_ascii_digit);
        if at.checked_sub(1).is_some_and(|before| digit(before).is_some()) {
            return None;
        }
        let run = |at: usize| (at..).map_while(digit).take(9).collect::<String>();
        let first = run(at);
        if let (8, Some((a, rest))) = (first.len(), first.split_at_checked(2)) {
            let (b, year) = rest.split_at_checked(2)?;
            return self.is_date(year, a, b).then_some(at + 8);
        }
        let sign = self.letter(at + first.len()).filter(|c| "-._ ".contains(*c))?;
        let second = run(at + first.len() + 1);
        let third_at = at + first.len() + second.len() + 2;
        if self.letter(third_at - 1) != Some(sign) {
            return None;
        }
        let third = run(third_at);
        let found = match [first.len(), second.len(), third.len()] {
            [4, 1..=2, 1..=2] => self.is_date(&first, &second, &third),
            [1..=2, 1..=2, 4] => self.is_date(&third, &second, &first),
            _ => false,
        };
        found.then_some(third_at + third.len())
    }

    /// Is this, with either number as the month, a birth date of a patient?
    fn is_date(&self, year: &str, a: &str, b: &str) -> bool {
        let known = |month: &str, day: &str| {
            let date = format!("{year}{month:0>2}{day:0>2}");
            self.words.kept.binary_search_by(|word| (**word).cmp(date.as_str())).is_ok()
                || self.own.iter().any(|word| word.iter().copied().eq(date.chars()))
        };
        known(a, b) || known(b, a)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn words(all: &[&str]) -> PatientWords {
        let kept: BTreeSet<_> = all.iter().map(|w| folded(w).collect::<String>().into_boxed_str()).collect();
        PatientWords { kept: kept.into_iter().collect(), full: false }
    }

    fn masked(words: &PatientWords, text: &str) -> String {
        words.masked(text, &[], "*", &|_, _| false)
    }

    #[test]
    fn long_words_are_found_anywhere_and_short_ones_apart() {
        let all = words(&["Müller", "Anna", "Annabel", "Kim", "042", "山田"]);
        for (text, expected) in [
            ("MÜLLER/ct", "*/ct"),
            ("xmüllerx", "x*x"),
            ("AnnabelMüller", "**"),
            ("Kim_CT/skimage", "*_CT/skimage"),
            ("ct2Kim3", "ct2*3"),
            ("KIMMÜLLER", "**"),
            ("MÜLLERkim", "**"),
            ("P042_1042", "P*_1042"),
            ("山田/a", "*/a"),
            ("", ""),
            ("Mülle", "Mülle"),
        ] {
            assert_eq!(masked(&all, text), expected, "{text}");
        }
        let own = ["im".to_owned(), String::new()];
        assert_eq!(all.masked("Times_Anna", &own, "*", &|_, _| false), "T*es_*");
        let spares = |text: &str, at: Range<usize>| text.get(at) == Some("anna");
        assert_eq!(all.masked("Anna, anna", &own, "*", &spares), "*, anna");
        assert_eq!(masked(&PatientWords::default(), "Anna"), "Anna");
        // Letters that become two in lower case.
        for (text, expected) in
            [("a-İNCI-b", "a-*-b"), ("a-İnci-b", "a-*-b"), ("a-Inci-b", "a-Inci-b"), ("aİ", "aİ")]
        {
            assert_eq!(masked(&words(&["İnci"]), text), expected);
        }
    }

    #[test]
    fn birth_dates_are_found_as_people_write_them() {
        let all = words(&["19700102", "P1"]);
        for text in [
            "19700102",
            "1970-01-02",
            "1970_1_2",
            "1970.01.02",
            "02.01.1970",
            "2.1.1970",
            "01-02-1970",
            "02011970",
            "01021970",
            "02 01 1970",
        ] {
            assert_eq!(masked(&all, &format!("ct_{text}/a")), "ct_*/a", "{text}");
        }
        for text in [
            "1970-02-03",
            "1970-01.02",
            "170-01-02",
            "19700103",
            "1970-01",
            "1970-",
            "02.01.70",
            "119700-01-02",
        ] {
            assert_eq!(masked(&all, text), text);
        }
    }

    #[test]
    fn of_too_many_words_the_longest_are_kept() {
        let mut gathered = Gathered::default();
        let name = |i: usize| format!("Long{i:06}");
        for i in 0..MOST_WORDS / 2 {
            gathered.note(&Secrets::of(&name(i), &format!("A{i:04}"), ""));
        }
        assert!(!gathered.full && gathered.kept.len() == MOST_WORDS);
        for i in MOST_WORDS / 2..MOST_WORDS {
            gathered.note(&Secrets::of(&name(i), "", ""));
        }
        let all = gathered.finish();
        assert!(all.is_full() && all.kept.len() == MOST_WORDS);
        assert!(all.kept.iter().all(|word| word.starts_with("long")), "the short ones went");
        assert_eq!(masked(&all, "A0001/Long000001"), "A0001/*");
        assert_eq!(format!("{all:?}"), "4096 words");
    }
}
