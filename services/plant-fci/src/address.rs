//! The address of a robot.

use std::fmt;
use std::str::FromStr;

/// The beginning of an address.
pub const SCHEME: &str = "fci://";

/// `fci://HOST[:PORT]`; without a port the interface's own, 1337.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Address {
    /// Host name or IP address, with the port where one is given.
    pub host: String,
}

impl FromStr for Address {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let wrong = || {
            format!(
                "`{text}` is not a robot's address: give {SCHEME}HOST, for example {SCHEME}172.16.0.2"
            )
        };
        let host = text
            .strip_prefix(SCHEME)
            .ok_or_else(wrong)?
            .trim_end_matches('/');
        let (name, port) = match host.rsplit_once(':') {
            Some((name, port)) => (name, port.parse::<u16>().ok().filter(|port| *port > 0)),
            None => (host, Some(1337)),
        };
        let is_name = !name.is_empty()
            && name
                .chars()
                .all(|c| c.is_ascii_alphanumeric() || ".-_".contains(c));
        if is_name && port.is_some() {
            Ok(Self {
                host: host.to_owned(),
            })
        } else {
            Err(wrong())
        }
    }
}

impl fmt::Display for Address {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{SCHEME}{}", self.host)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_address_is_a_scheme_and_a_host() {
        for right in [
            "fci://172.16.0.2",
            "fci://localhost",
            "fci://arm-1.lab:1337",
        ] {
            assert_eq!(right.parse::<Address>().unwrap().to_string(), right);
        }
        assert_eq!(
            "fci://127.0.0.1/".parse::<Address>().unwrap().host,
            "127.0.0.1"
        );
        for wrong in [
            "172.16.0.2",
            "fci://",
            "http://a",
            "fci://a:b",
            "fci://a:0",
            "fci://a b",
            "fci://:1337",
        ] {
            let refused = wrong.parse::<Address>().unwrap_err();
            assert!(
                refused.contains(wrong) && refused.contains("fci://HOST"),
                "{refused}"
            );
        }
    }
}
