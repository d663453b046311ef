//! A text's words: in lower case, without punctuation, with syllables and a stressed vowel.

/// Longest word that is compared in full, bytes; of a longer one only the beginning.
pub(crate) const MAX_BYTES: usize = 48;

const VOWELS: &str = "aeiouyäöüáàâãåæéèêëíìîïóòôõøúùûýœаеёиоуыэюя";

/// A word of a text.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Spoken<'a> {
    /// The word without punctuation at its ends, or `?`.
    pub text: &'a str,
    /// Whether punctuation follows: no phrase goes on across it.
    pub is_end: bool,
}

/// Returns the words of a text in order. Blanks, hyphens, dashes, slashes and underscores separate them; a
/// question mark is a word of its own without duration.
pub fn spoken(text: &str) -> impl Iterator<Item = Spoken<'_>> {
    let parts = text.split(|c: char| c.is_whitespace() || matches!(c, '-' | '_' | '/' | '\u{2010}'..='\u{2015}'));
    parts.flat_map(|part| {
        let word = part.trim_matches(|c: char| !c.is_alphanumeric());
        let tail = part.rsplit(char::is_alphanumeric).next().unwrap_or_default();
        let asks = tail.contains('?');
        let is_end = tail.contains(['.', ',', ';', ':', '!', '…', ')', '。', '、']);
        let said = (!word.is_empty()).then_some(Spoken { text: word, is_end });
        let mark = asks.then_some(Spoken { text: "?", is_end: true });
        [said, mark].into_iter().flatten()
    })
}

/// A word in lower case, in a buffer of its own.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Normal {
    bytes: [u8; MAX_BYTES],
    length: usize,
}

impl Normal {
    pub(crate) fn new(word: &str) -> Self {
        let mut normal = Self { bytes: [0; MAX_BYTES], length: 0 };
        for c in word.chars().flat_map(char::to_lowercase) {
            let c = if matches!(c, '\u{2019}' | '\u{2018}' | 'ʼ' | '`') { '\'' } else { c };
            let end = normal.length + c.len_utf8();
            if end > MAX_BYTES {
                break;
            }
            c.encode_utf8(&mut normal.bytes[normal.length..end]);
            normal.length = end;
        }
        normal
    }

    pub(crate) fn as_str(&self) -> &str {
        std::str::from_utf8(&self.bytes[..self.length]).unwrap_or_default()
    }
}

fn is_vowel(c: char) -> bool {
    VOWELS.contains(c)
}

/// Syllables and stressed vowel of a word in lower case.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Sound {
    /// Number of syllables, at least 1; 0 for punctuation.
    pub(crate) syllables: u32,
    /// Middle of the stressed vowel, as a share of the word's duration.
    pub(crate) stress: f32,
}

impl Sound {
    /// The first syllable of words that begin with one of `unstressed` is not stressed; with `silent_e`, an `e` at the end
    /// after a consonant is not spoken.
    pub(crate) fn new(word: &str, unstressed: &[String], silent_e: bool) -> Self {
        if !word.contains(char::is_alphanumeric) {
            return Self { syllables: 0, stress: 0.0 };
        }
        let digits = word.chars().filter(char::is_ascii_digit).count();
        let spoken = match word.strip_suffix('e') {
            // "make", not "the" and not "table".
            Some(rest) if silent_e && !rest.ends_with('l') && rest.contains(is_vowel) => rest,
            _ => word,
        };
        let length = word.chars().count() as f32;
        let stressed = 1 + u32::from(unstressed.iter().any(|begin| word.starts_with(begin.as_str())));
        let (mut groups, mut stress, mut was_vowel) = (0_u32, None, false);
        for (number, c) in spoken.chars().enumerate() {
            let vowel = is_vowel(c);
            if vowel && !was_vowel {
                groups += 1;
                if groups <= stressed {
                    stress = Some((number as f32 + 0.5) / length);
                }
            }
            was_vowel = vowel;
        }
        let stress = stress.unwrap_or(0.4).clamp(0.15, 0.8);
        Self { syllables: (groups + u32::try_from(digits).unwrap_or(0)).max(1), stress }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_text_falls_into_words() {
        let words: Vec<_> =
            spoken("“No, it’s well-known — isn't it?” 3.5!").map(|word| (word.text, word.is_end)).collect();
        let wanted = [
            ("No", true),
            ("it’s", false),
            ("well", false),
            ("known", false),
            ("isn't", false),
            ("it", false),
            ("?", true),
            ("3.5", true),
        ];
        assert_eq!(words, wanted);
        assert_eq!(Normal::new("IT’S").as_str(), "it's");
        let long = "ä".repeat(100);
        assert_eq!(Normal::new(&long).as_str(), "ä".repeat(MAX_BYTES / 2));
        assert_eq!(spoken(" … -- ").count(), 0);
    }

    #[test]
    fn syllables_and_stress_are_near_what_people_say() {
        let unstressed = ["remem".to_owned(), "be".to_owned()];
        let sound = |word: &str| Sound::new(word, &unstressed, true);
        for (word, syllables) in
            [("no", 1), ("make", 1), ("table", 2), ("the", 1), ("enormous", 3), ("?", 0), ("xyz", 1), ("12", 2)]
        {
            assert_eq!(sound(word).syllables, syllables, "{word}");
        }
        assert!(sound("nobody").stress < 0.3 && (0.4..0.6).contains(&sound("remember").stress));
        // There is no second one.
        assert!((sound("be").stress - 0.75).abs() < 1e-6);
        assert_eq!(sound("w").stress, 0.4);
    }
}
