//! Access to a broker on the command line.

use std::convert::Infallible;
use std::path::PathBuf;
use std::str::FromStr;

use miette::IntoDiagnostic;

use deltatwin_watch::broker::{Broker, Secret};

/// Address of a broker as it was given. It may contain a password: no message about the command line shows it.
#[derive(Clone, Debug)]
pub struct Given(Secret);

impl FromStr for Given {
    type Err = Infallible;

    fn from_str(text: &str) -> Result<Self, Infallible> {
        Ok(Self(text.into()))
    }
}

/// What gives access to a broker.
#[derive(clap::Args, Clone, Debug)]
pub struct Access {
    /// Certificates in PEM of the authorities that sign the certificate of a broker at mqtts://; without it, those that
    /// this system trusts.
    #[arg(long, value_name = "FILE", requires = "mqtt")]
    pub ca: Option<PathBuf>,
    /// File with two lines, user and password, that only its owner may read; without it, the environment variables
    /// DELTATWIN_MQTT_USER and DELTATWIN_MQTT_PASSWORD.
    #[arg(long, value_name = "FILE", requires = "mqtt")]
    pub mqtt_login: Option<PathBuf>,
}

impl Access {
    /// The broker at an address.
    pub fn broker(&self, address: &Given) -> miette::Result<Broker> {
        let address = address.0.reveal().parse().into_diagnostic()?;
        Broker::new(address, self.mqtt_login.as_deref(), self.ca.as_deref()).into_diagnostic()
    }
}
