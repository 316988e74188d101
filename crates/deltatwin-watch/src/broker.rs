//! Where a broker is, and what gives access to it: login and certificates.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use rumqttc::TlsConfiguration;
use rustls::pki_types::{CertificateDer, pem::PemObject};
use rustls::{ClientConfig, RootCertStore};
use thiserror::Error;

/// Ports without and with TLS.
const PORTS: [u16; 2] = [1883, 8883];
/// Largest size of a file with a login or with certificates, bytes.
const LARGEST: u64 = 16 << 20;
/// Environment variables with the login.
const VARIABLES: [&str; 2] = ["DELTATWIN_MQTT_USER", "DELTATWIN_MQTT_PASSWORD"];

/// Reason why there is no access to a broker. The login is in none of them.
#[derive(Debug, Error)]
pub enum AccessError {
    /// Not the address of a broker.
    #[error("the address of the broker {0}; expected mqtt://HOST or mqtt://HOST:PORT, with TLS mqtts://…")]
    Address(&'static str),
    /// A file cannot be used.
    #[error("{}: {problem}", file.display())]
    File {
        /// The file.
        file: PathBuf,
        /// What is wrong, and what was expected.
        problem: String,
    },
    /// Parts of the access do not fit together.
    #[error("{0}")]
    Contrary(&'static str),
    /// TLS cannot be used.
    #[error("TLS cannot be used: {0}; expected certificates of this system, or --ca FILE")]
    Tls(String),
}

/// A text that no output contains.
#[derive(Clone, PartialEq, Eq)]
pub struct Secret(String);

impl Secret {
    /// The text itself.
    pub fn reveal(&self) -> &str {
        &self.0
    }
}

impl From<&str> for Secret {
    fn from(text: &str) -> Self {
        Self(text.into())
    }
}

impl std::fmt::Debug for Secret {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("***")
    }
}

impl std::fmt::Display for Secret {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("***")
    }
}

/// User and password.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Login {
    /// User.
    pub user: Secret,
    /// Password.
    pub password: Secret,
}

impl Login {
    /// The login in a file of two lines, user and password, that only its owner may read.
    ///
    /// # Errors
    /// [`AccessError::File`].
    pub fn read(file: &Path) -> Result<Self, AccessError> {
        let refused = |problem: String| AccessError::File { file: file.into(), problem };
        #[cfg(unix)]
        {
            use std::os::unix::fs::PermissionsExt;
            let mode =
                std::fs::metadata(file).map_err(|e| refused(format!("cannot be read: {e}")))?.permissions().mode();
            if mode & 0o007 != 0 {
                let mode = mode & 0o777;
                return Err(refused(format!(
                    "is open to every user (permissions {mode:o}); expected 600, by chmod 600"
                )));
            }
        }
        let bytes = deltatwin_io::file::bytes(file, LARGEST).map_err(|e| refused(format!("cannot be read: {e}")))?;
        let text = String::from_utf8(bytes).unwrap_or_default();
        let mut lines = text.trim_start_matches('\u{feff}').lines();
        match [lines.next(), lines.next()] {
            [Some(user), Some(password)] if !user.is_empty() => {
                Ok(Self { user: user.into(), password: password.into() })
            }
            _ => Err(refused("has no login; expected two lines of text, the user and the password".into())),
        }
    }

    /// The login in the environment variables `DELTATWIN_MQTT_USER` and `DELTATWIN_MQTT_PASSWORD`, if they are set.
    ///
    /// # Errors
    /// [`AccessError::Contrary`] for a password without a user.
    pub fn of_environment() -> Result<Option<Self>, AccessError> {
        let [user, password] = VARIABLES.map(|name| std::env::var(name).ok().map(Secret));
        match (user, password) {
            (Some(user), password) => Ok(Some(Self { user, password: password.unwrap_or("".into()) })),
            (None, None) => Ok(None),
            (None, Some(_)) => {
                Err(AccessError::Contrary("DELTATWIN_MQTT_PASSWORD is set without DELTATWIN_MQTT_USER; expected both"))
            }
        }
    }
}

/// Address of a broker; what is displayed has no login.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Address {
    /// Host name or IP address.
    pub host: String,
    /// TCP port.
    pub port: u16,
    /// Whether the connection is by TLS.
    pub is_secure: bool,
    /// The login in the address.
    pub login: Option<Login>,
}

impl std::str::FromStr for Address {
    type Err = AccessError;

    fn from_str(text: &str) -> Result<Self, AccessError> {
        let wrong = AccessError::Address;
        let secure = text.strip_prefix("mqtts://");
        let plain = || text.strip_prefix("mqtt://");
        let rest = secure.or_else(plain).ok_or(wrong("does not begin with mqtt:// or mqtts://"))?;
        let (login, place) = match rest.trim_end_matches('/').rsplit_once('@') {
            Some((who, place)) => {
                let (user, password) = who.split_once(':').unwrap_or((who, ""));
                (Some(Login { user: user.into(), password: password.into() }), place)
            }
            None => (None, rest.trim_end_matches('/')),
        };
        // The colons of an IPv6 address stand in brackets.
        let (host, port) = match place.rsplit_once(':') {
            Some((host, port)) if !port.contains(']') => {
                (host, port.parse().map_err(|_| wrong("has no number from 0 to 65535 as its port"))?)
            }
            _ => (place, PORTS[usize::from(secure.is_some())]),
        };
        let host = host.trim_start_matches('[').trim_end_matches(']');
        if host.is_empty() || host.contains(['/', ' ']) {
            return Err(wrong("has no host"));
        }
        Ok(Self { host: host.into(), port, is_secure: secure.is_some(), login })
    }
}

impl std::fmt::Display for Address {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "mqtt{}://{}:{}", if self.is_secure { "s" } else { "" }, self.host, self.port)
    }
}

/// A broker with what gives access to it.
#[derive(Clone)]
pub struct Broker {
    /// Where it is; its login is that of the broker.
    pub address: Address,
    /// How its certificate is verified, with TLS.
    pub(crate) tls: Option<Arc<ClientConfig>>,
}

impl Broker {
    /// The broker at `address` with the login in the address, else in the file `login`, else in the environment. With TLS
    /// its certificate must be signed by an authority in the file `ca`, else by one that this system trusts.
    ///
    /// # Errors
    /// An [`AccessError`].
    pub fn new(mut address: Address, login: Option<&Path>, ca: Option<&Path>) -> Result<Self, AccessError> {
        address.login = match (address.login.take(), login) {
            (Some(_), Some(_)) => {
                return Err(AccessError::Contrary(
                    "the address and --mqtt-login both give a login; expected one of them",
                ));
            }
            (Some(login), None) => Some(login),
            (None, Some(file)) => Some(Login::read(file)?),
            (None, None) => Login::of_environment()?,
        };
        if ca.is_some() && !address.is_secure {
            return Err(AccessError::Contrary("--ca is given for a connection without TLS; expected mqtts://HOST"));
        }
        let tls = if address.is_secure { Some(verification(ca)?) } else { None };
        Ok(Self { address, tls })
    }
}

/// Verification of a certificate by the authorities in a file, or by those of the system.
fn verification(ca: Option<&Path>) -> Result<Arc<ClientConfig>, AccessError> {
    let Some(file) = ca else {
        return match TlsConfiguration::try_default_rustls() {
            Ok(TlsConfiguration::Rustls(config)) => Ok(config),
            Ok(_) => Err(AccessError::Tls("without rustls".into())),
            Err(e) => Err(AccessError::Tls(e.to_string())),
        };
    };
    let refused = |problem: String| AccessError::File { file: file.into(), problem };
    let bad = |e: &dyn std::fmt::Display| refused(format!("has a certificate that cannot be used: {e}"));
    let bytes = deltatwin_io::file::bytes(file, LARGEST).map_err(|e| refused(format!("cannot be read: {e}")))?;
    let mut roots = RootCertStore::empty();
    for certificate in CertificateDer::pem_slice_iter(&bytes) {
        roots.add(certificate.map_err(|e| bad(&e))?).map_err(|e| bad(&e))?;
    }
    if roots.is_empty() {
        return Err(refused("has no certificate; expected one or more in PEM, -----BEGIN CERTIFICATE-----".into()));
    }
    let provider = Arc::new(rustls::crypto::ring::default_provider());
    let versions = ClientConfig::builder_with_provider(provider).with_safe_default_protocol_versions();
    let config = versions.map_err(|e| AccessError::Tls(e.to_string()))?;
    Ok(Arc::new(config.with_root_certificates(roots).with_no_client_auth()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn addresses() {
        let parsed = |text: &str| text.parse::<Address>();
        let plain = parsed("mqtt://127.0.0.1").unwrap();
        assert_eq!((plain.host.as_str(), plain.port, plain.login, plain.is_secure), ("127.0.0.1", 1883, None, false));
        let full = parsed("mqtt://robot:se:cret@broker.example:2000/").unwrap();
        assert_eq!((full.host.as_str(), full.port), ("broker.example", 2000));
        assert_eq!(full.login, Some(Login { user: "robot".into(), password: "se:cret".into() }));
        assert_eq!(parsed("mqtt://[::1]:1999").unwrap().host, "::1");
        let secure = parsed("mqtts://u:secret@broker").unwrap();
        assert_eq!((secure.to_string(), secure.port), ("mqtts://broker:8883".into(), 8883));
        for wrong in ["", "127.0.0.1", "mqttx://a", "mqtt://", "mqtt://a:b", "mqtts://a:70000", "mqtt://a/b"] {
            assert!(parsed(wrong).is_err(), "{wrong}");
        }
    }

    #[test]
    fn no_output_contains_a_login() {
        for text in ["mqtts://u:secret@broker:99999", "mqtts://u:secret", "http://u:secret@h", "mqtt://u:secret@"] {
            let e = text.parse::<Address>().unwrap_err();
            assert!(!format!("{e} {e:?}").contains("secret"), "{e}");
        }
        let address: Address = "mqtt://robot:secret@broker".parse().unwrap();
        let shown = format!("{address} {address:?} {}", address.login.as_ref().unwrap().password);
        assert!(!shown.contains("secret") && !shown.contains("robot"), "{shown}");
    }

    #[cfg(unix)]
    #[test]
    fn a_login_is_read_from_a_file_of_its_owner() {
        use std::os::unix::fs::PermissionsExt;
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("login");
        let read = |text: &str, mode: u32| {
            std::fs::write(&file, text).unwrap();
            std::fs::set_permissions(&file, std::fs::Permissions::from_mode(mode)).unwrap();
            Login::read(&file).map_err(|e| e.to_string())
        };
        let login = Login { user: "robot".into(), password: "a b:@ c".into() };
        assert_eq!(read("robot\r\na b:@ c\r\n", 0o600), Ok(login.clone()));
        assert_eq!(read("robot\na b:@ c", 0o640), Ok(login));
        let e = read("robot\nsecret\n", 0o644).unwrap_err();
        assert!(e.contains("permissions 644") && e.contains("chmod 600") && !e.contains("secret"), "{e}");
        for wrong in ["", "secret", "\nsecret\n"] {
            let e = read(wrong, 0o600).unwrap_err();
            assert!(e.contains("expected two lines") && !e.contains("secret"), "{e}");
        }
        let address: Address = "mqtt://a:b@h".parse().unwrap();
        assert!(matches!(Broker::new(address, Some(&file), None), Err(AccessError::Contrary(_))));
        let [plain, secure] = ["mqtt://h", "mqtts://h"].map(|text| text.parse::<Address>().unwrap());
        assert!(matches!(Broker::new(plain, None, Some(&file)), Err(AccessError::Contrary(_))));
        let e = Broker::new(secure, None, Some(&file)).err().map(|e| e.to_string()).unwrap_or_default();
        assert!(e.contains("expected one or more in PEM"), "{e}");
    }
}
