//! The store of a URL, configured from options and environment.

use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

use object_store::aws::{AmazonS3Builder, AmazonS3ConfigKey};
use object_store::azure::{AzureConfigKey, MicrosoftAzureBuilder};
use object_store::gcp::{GoogleCloudStorageBuilder, GoogleConfigKey};
use object_store::http::HttpBuilder;
use object_store::list::PaginatedListStore;
use object_store::path::Path as StorePath;
use object_store::{BackoffConfig, ClientConfigKey, ClientOptions, ObjectStore, RetryConfig};
use spinney_base::io::shown;
use spinney_base::{Error, Result};
use url::Url;

use super::connections::{Bucket, Connections};
use super::connector::{self, Connector};
use super::{error, profile};

/// A store, and the name of a file in it.
#[derive(Clone)]
pub(super) struct ObjectLocation {
    pub(super) store: Arc<dyn ObjectStore>,
    /// Lister of the files of a prefix, page by page; `None` if the store has none.
    pub(super) pages: Option<Arc<dyn PaginatedListStore>>,
    pub(super) name: StorePath,
}

impl ObjectLocation {
    /// Finds the store and the name of a URL. Given options override those of the environment
    /// (`AWS_...`, `GOOGLE_...`, `AZURE_...`).
    ///
    /// # Errors
    /// If the URL is invalid, or an option is unknown or invalid.
    pub(super) fn of(
        url: &str,
        storage: &[(String, String)],
        connections: &Connections,
    ) -> Result<ObjectLocation> {
        let options = &connections.options;
        let path = Path::new(url);
        let url = &*connections.secrets.complete(url)?;
        let mut parsed = Url::parse(url).map_err(|cause| {
            let found = format!("`{}` ({cause})", shown(Path::new(url)));
            Error::invalid("URL", found, "the URL of a file: scheme://host/path")
        })?;
        let retry = RetryConfig {
            backoff: BackoffConfig::default(),
            max_retries: options.retries,
            retry_timeout: options.limit,
        };
        // Allow plain HTTP, which users request by `http://` URLs and endpoints.
        let client = ClientOptions::new()
            .with_timeout(options.timeout.min(options.limit))
            .with_connect_timeout(options.timeout.min(options.limit).min(Duration::from_secs(10)))
            .with_allow_http(true);
        let bad = |cause| error::of_store(path, "connect to its store", cause);
        let name = StorePath::from_url_path(parsed.path()).map_err(|cause| bad(cause.into()))?;
        let (prefix, own) = match parsed.scheme() {
            "s3" | "s3a" => ("AWS_", profile::settings()),
            "gs" | "gcs" => ("GOOGLE_", Vec::new()),
            "az" | "adl" | "azure" | "abfs" | "abfss" => ("AZURE_", Vec::new()),
            "memory" => {
                return Ok(ObjectLocation { store: connections.memory.clone(), pages: None, name });
            }
            _ => {
                // The store's URL is that of the file, including a query that may be a signature.
                // The name below it is empty.
                let headers = connector::take_user(&mut parsed).map_err(bad)?;
                let mut client = client.with_default_headers(headers);
                for (key, value) in storage {
                    client = client.with_config(known::<ClientConfigKey>(key)?, value);
                }
                parsed.set_fragment(None);
                let builder = HttpBuilder::new()
                    .with_http_connector(Connector)
                    .with_url(parsed.as_str())
                    .with_retry(retry)
                    .with_client_options(client);
                let store = builder.build().map_err(bad)?;
                let (store, name) = (Arc::new(store), StorePath::default());
                return Ok(ObjectLocation { store, pages: None, name });
            }
        };
        let settings: Vec<_> =
            own.into_iter().chain(environment(prefix)).chain(storage.iter().cloned()).collect();
        let bucket = bucket(&parsed);
        let key = (std::process::id(), bucket.clone(), settings.clone(), profile::is_unsigned());
        let make = || -> Result<Bucket> {
            match prefix {
                "AWS_" => {
                    let mut builder = AmazonS3Builder::new()
                        .with_http_connector(Connector)
                        .with_url(bucket)
                        .with_retry(retry)
                        .with_client_options(client);
                    for (key, value) in settings {
                        builder = builder.with_config(known::<AmazonS3ConfigKey>(&key)?, value);
                    }
                    // Anonymous reads must not query a metadata service for credentials.
                    let has_any = [
                        AmazonS3ConfigKey::AccessKeyId,
                        AmazonS3ConfigKey::WebIdentityTokenFile,
                        AmazonS3ConfigKey::ContainerCredentialsRelativeUri,
                        AmazonS3ConfigKey::ContainerCredentialsFullUri,
                    ];
                    let is_anonymous = has_any.iter().all(|key| builder.get_config_value(key).is_none())
                        && builder.get_config_value(&AmazonS3ConfigKey::SkipSignature).is_none()
                        && profile::is_unsigned();
                    if is_anonymous {
                        builder = builder.with_skip_signature(true);
                    }
                    Ok(Bucket::new(builder.build().map_err(bad)?))
                }
                "GOOGLE_" => {
                    let mut builder = GoogleCloudStorageBuilder::new()
                        .with_http_connector(Connector)
                        .with_url(bucket.replacen("gcs://", "gs://", 1))
                        .with_retry(retry)
                        .with_client_options(client);
                    for (key, value) in settings {
                        builder = builder.with_config(known::<GoogleConfigKey>(&key)?, value);
                    }
                    Ok(Bucket::new(builder.build().map_err(bad)?))
                }
                _ => {
                    let mut builder = MicrosoftAzureBuilder::new()
                        .with_http_connector(Connector)
                        .with_url(bucket)
                        .with_retry(retry)
                        .with_client_options(client);
                    for (key, value) in settings {
                        builder = builder.with_config(known::<AzureConfigKey>(&key)?, value);
                    }
                    Ok(Bucket::new(builder.build().map_err(bad)?))
                }
            }
        };
        let Bucket { store, pages } = connections.bucket(key, make)?;
        Ok(ObjectLocation { store, pages, name })
    }
}

/// The prefix of a URL up to the bucket.
fn bucket(url: &Url) -> String {
    url[..url::Position::BeforePath].to_string()
}

/// Parses the key of a setting.
fn known<K: std::str::FromStr>(key: &str) -> Result<K> {
    key.to_ascii_lowercase().parse().map_err(|_| {
        let expected = "an option of this store, such as `aws_region`, `endpoint`, `token`, `google_service_account`, `account_name` or `proxy_url`";
        Error::invalid("storage option", format!("`{key}`"), expected)
    })
}

/// Settings of a store in the environment. Variables that the store does not know are omitted.
fn environment(prefix: &str) -> Vec<(String, String)> {
    let is_known = |key: &str| match prefix {
        "AWS_" => known::<AmazonS3ConfigKey>(key).is_ok(),
        "GOOGLE_" => known::<GoogleConfigKey>(key).is_ok(),
        _ => known::<AzureConfigKey>(key).is_ok(),
    };
    let all = std::env::vars_os()
        .filter_map(|(key, value)| Some((key.into_string().ok()?, value.into_string().ok()?)));
    let mut settings: Vec<(String, String)> =
        all.filter(|(key, value)| key.starts_with(prefix) && is_known(key) && !value.is_empty()).collect();
    spinney_base::sort::by(&mut settings, &mut Ord::cmp);
    settings
}
