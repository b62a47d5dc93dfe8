//! One value of a table.

/// The type of a column's values.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Kind {
    /// True or false.
    Boolean,
    /// Whole numbers.
    Whole,
    /// Numbers.
    Number,
    /// Text.
    Text,
}

/// One value.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Cell {
    /// There is none.
    Absent,
    /// Of [`Kind::Boolean`].
    Boolean(bool),
    /// Of [`Kind::Whole`].
    Whole(i64),
    /// Of [`Kind::Number`].
    Number(f64),
    /// Of [`Kind::Text`].
    Text(String),
}

impl Cell {
    /// The value as a number, where it is one.
    pub(super) fn number(&self) -> Option<f64> {
        match self {
            Self::Boolean(so) => Some(f64::from(u8::from(*so))),
            Self::Whole(number) => Some(*number as f64),
            Self::Number(number) => Some(*number),
            Self::Absent | Self::Text(_) => None,
        }
    }

    /// The value as text of one line, from which [`read`](Self::read) makes the same bits.
    pub(super) fn write(&self) -> String {
        match self {
            Self::Absent => "-".to_owned(),
            Self::Boolean(so) => format!("b{}", u8::from(*so)),
            Self::Whole(number) => format!("i{number}"),
            Self::Number(number) => format!("f{:016x}", number.to_bits()),
            Self::Text(text) => format!("t{text}"),
        }
    }

    /// The value of a text.
    pub(super) fn read(text: &str) -> Option<Self> {
        let rest = text.get(1..)?;
        Some(match &text[..1] {
            "-" => Self::Absent,
            "b" => Self::Boolean(rest == "1"),
            "i" => Self::Whole(rest.parse().ok()?),
            "f" => Self::Number(f64::from_bits(u64::from_str_radix(rest, 16).ok()?)),
            "t" => Self::Text(rest.to_owned()),
            _ => return None,
        })
    }
}

impl std::fmt::Display for Cell {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Absent => f.write_str("–"),
            Self::Boolean(so) => write!(f, "{so}"),
            Self::Whole(number) => write!(f, "{number}"),
            Self::Number(number) => f.write_str(&viz::plot::digits(*number)),
            Self::Text(text) => f.write_str(text),
        }
    }
}
