//! Spans of requests and frames for an OpenTelemetry collector, over OTLP (HTTP and protobuf).
//!
//! Spans have the fields that the log has at level `debug`: ids of requests, routes, sizes, times;
//! nothing that names a patient. They are sent by a thread of their own, in batches, and are dropped
//! when the collector does not keep up.

use std::collections::HashMap;
use std::time::Duration;

use opentelemetry::propagation::TextMapPropagator;
use opentelemetry::trace::TracerProvider;
use opentelemetry_otlp::{Protocol, SpanExporter, WithExportConfig};
use opentelemetry_sdk::Resource;
use opentelemetry_sdk::propagation::TraceContextPropagator;
use opentelemetry_sdk::trace::{SdkTracerProvider, Tracer};
use tracing::Subscriber;
use tracing_opentelemetry::{OpenTelemetryLayer, OpenTelemetrySpanExt};
use tracing_subscriber::EnvFilter;
use tracing_subscriber::Layer;
use tracing_subscriber::registry::LookupSpan;

use relief_server::TraceHeaders;

/// The longest time of a batch, and of the last one at the end of the program.
const PATIENCE: Duration = Duration::from_secs(2);

/// The way to a collector. Dropping it sends the remaining spans.
#[derive(Debug)]
pub(super) struct Traces {
    provider: SdkTracerProvider,
    tracer: Tracer,
}

impl Traces {
    /// Spans are sent to `URL/v1/traces`.
    ///
    /// # Errors
    /// When the address is invalid. A collector that cannot be reached is a warning in the log.
    pub(super) fn open(url: &str) -> anyhow::Result<Self> {
        // Another part of the program may have done so already.
        let _ = rustls::crypto::ring::default_provider().install_default();
        let exporter = SpanExporter::builder()
            .with_http()
            .with_protocol(Protocol::HttpBinary)
            .with_endpoint(format!("{}/v1/traces", url.trim_end_matches('/')))
            .with_timeout(PATIENCE)
            .build()?;
        let resource = Resource::builder().with_service_name("relief").build();
        let provider =
            SdkTracerProvider::builder().with_batch_exporter(exporter).with_resource(resource).build();
        let tracer = provider.tracer("relief");
        Ok(Self { provider, tracer })
    }

    /// The layer that records spans of Relief's own crates.
    pub(super) fn layer<S>(&self) -> impl Layer<S> + use<S>
    where
        S: Subscriber + for<'span> LookupSpan<'span>,
    {
        OpenTelemetryLayer::new(self.tracer.clone())
            .with_location(false)
            .with_threads(false)
            .with_filter(EnvFilter::new("off,relief=debug"))
    }
}

/// Makes a span a part of its caller's trace. Without a collector nothing records the span.
pub(super) fn join(span: &tracing::Span, headers: TraceHeaders<'_>) {
    let mut carrier = HashMap::from([("traceparent".to_owned(), headers.parent.to_owned())]);
    carrier.extend(headers.state.map(|state| ("tracestate".to_owned(), state.to_owned())));
    if let Err(error) = span.set_parent(TraceContextPropagator::new().extract(&carrier)) {
        tracing::trace!(%error, "the span joins no trace");
    }
}

impl Drop for Traces {
    fn drop(&mut self) {
        if let Err(error) = self.provider.shutdown_with_timeout(PATIENCE) {
            tracing::warn!(%error, "the last traces were not sent");
        }
    }
}
