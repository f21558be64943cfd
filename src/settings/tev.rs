//! The address of the image viewer tev.

use std::fmt;
use std::net::Ipv6Addr;
use std::str::FromStr;

use serde::{Serialize, Serializer};

use crate::error::{Error, Result};
use crate::settings::setting::value_from_text;
use crate::settings::typed::{Typed, typed};

/// The address at which tev listens by default.
pub const DEFAULT_TEV: &str = "127.0.0.1:14158";

/// Maximum length of a host name in bytes (RFC 1035).
const MAX_HOST: usize = 253;

/// The address of a tev: a host name or an IP address, and a port.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct TevAddress {
    /// Without the brackets of an IPv6 address.
    host: String,
    port: u16,
}

impl TevAddress {
    /// Host and port, as the standard library looks them up.
    pub fn as_pair(&self) -> (&str, u16) {
        (&self.host, self.port)
    }
}

impl FromStr for TevAddress {
    type Err = Error;

    fn from_str(text: &str) -> Result<TevAddress> {
        let parts = text.trim().rsplit_once(':').and_then(|(host, port)| {
            let is_number = port.bytes().all(|digit| digit.is_ascii_digit());
            let port = port.parse().ok().filter(|port| is_number && *port > 0)?;
            Some(TevAddress { host: host_of(host)?.into(), port })
        });
        parts.ok_or_else(|| {
            Error::advice(
                format!("'{text}' is not the address of a tev: "),
                format!("write HOST:PORT, like {DEFAULT_TEV}, localhost:14158 or [::1]:14158"),
            )
        })
    }
}

/// The host of an address, without brackets; `None` if it cannot be a host.
fn host_of(text: &str) -> Option<&str> {
    if let Some(inner) = text.strip_prefix('[') {
        let host = inner.strip_suffix(']')?;
        // fe80::1%eth0 names the network card too.
        let (address, card) = host.split_once('%').unwrap_or((host, "eth0"));
        return (address.parse::<Ipv6Addr>().is_ok() && is_name(card)).then_some(host);
    }
    is_name(text).then_some(text)
}

fn is_name(text: &str) -> bool {
    let is_part = |c: u8| c.is_ascii_alphanumeric() || matches!(c, b'-' | b'.' | b'_');
    (1..=MAX_HOST).contains(&text.len()) && text.bytes().all(is_part)
}

/// Prints text that parses to the same address.
impl fmt::Display for TevAddress {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let TevAddress { host, port } = self;
        if host.contains(':') { write!(f, "[{host}]:{port}") } else { write!(f, "{host}:{port}") }
    }
}

impl Serialize for TevAddress {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_str(self)
    }
}

typed! { TevAddress, "expected true or an address like \"127.0.0.1:14158\"":
    Typed::Wanted(true) => DEFAULT_TEV.parse(),
    Typed::Wanted(false) => Err(Error::advice("tev cannot be false: ", "remove the key")),
    Typed::Text(text) => text.parse(),
}

value_from_text!(TevAddress);

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn addresses_are_a_host_and_a_port() {
        for (text, host, port) in [
            (DEFAULT_TEV, "127.0.0.1", 14158),
            ("my-laptop.example.org:1", "my-laptop.example.org", 1),
            ("[::1]:65535", "::1", 65535),
            (" [fe80::1%eth0]:14158", "fe80::1%eth0", 14158),
        ] {
            let address: TevAddress = text.parse().unwrap();
            assert_eq!(address.as_pair(), (host, port), "{text}");
            assert_eq!(address.to_string(), text.trim());
        }
    }

    #[test]
    fn nonsense_is_refused_with_an_example() {
        for text in [
            "",
            ":",
            "localhost",
            ":14158",
            "localhost:",
            "localhost:0",
            "localhost:65536",
            "localhost:+1",
            "localhost:-1",
            "localhost:port",
            "::1",
            "::1:14158",
            "[::1]",
            "[::1:14158",
            "[localhost]:1",
            "[::1%]:1",
            "[]:1",
            "a b:1",
            "a\0b:1",
            "http://localhost:14158",
            "user@host:1",
            "room.glb",
            "C:\\room.glb",
            "hôst:1",
        ] {
            let message = text.parse::<TevAddress>().unwrap_err().to_string();
            assert!(message.contains("write HOST:PORT, like 127.0.0.1:14158"), "{text}: {message}");
        }
        let long = format!("{}:1", "a".repeat(MAX_HOST + 1));
        assert!(long.parse::<TevAddress>().is_err());
    }
}
