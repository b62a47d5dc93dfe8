//! Enumerations that are words in files.

/// Declares an enumeration of words: the variants, and their spelling in files. The first is the default.
macro_rules! words {
    ($(#[$meta:meta])* $name:ident { $( $( #[doc = $doc:literal] )+ $variant:ident $word:literal ),* $(,)? }) => {
        $(#[$meta])*
        #[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, serde::Serialize, serde::Deserialize)]
        pub enum $name { $( $( #[doc = $doc] )+ #[serde(rename = $word)] $variant ),* }

        impl $name {
            /// All of them, in order: in shared memory the place is the number.
            pub const ALL: [Self; [$($word),*].len()] = [$(Self::$variant),*];

            /// As written in files.
            #[must_use]
            pub fn name(self) -> &'static str {
                match self { $( Self::$variant => $word ),* }
            }

            /// A sentence or two.
            #[must_use]
            pub fn about(self) -> &'static str {
                match self { $( Self::$variant => concat!($( $doc ),+).trim_ascii() ),* }
            }
        }

        impl Default for $name {
            fn default() -> Self {
                Self::ALL[0]
            }
        }

        impl std::fmt::Display for $name {
            fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
                f.write_str(self.name())
            }
        }

        impl std::str::FromStr for $name {
            type Err = String;
            fn from_str(word: &str) -> Result<Self, String> {
                let known = || Self::ALL.map(Self::name).join(", ");
                Self::ALL.into_iter().find(|one| one.name() == word).ok_or_else(|| format!("there is no `{word}`; there are {}", known()))
            }
        }
    };
}
pub(crate) use words;
