# The image of one server: the release binary and the software driver that it is fastest with.
FROM rust:1.95-bookworm AS build
RUN apt-get update && apt-get install -y --no-install-recommends cmake g++ && rm -rf /var/lib/apt/lists/*
WORKDIR /relief
COPY . .
# A server has no window.
RUN cargo build --release --locked --features archives,buckets,jpeg-ls,postgres,queue,traces

FROM debian:bookworm-slim
RUN sed 's/bookworm bookworm-updates/bookworm-backports/' /etc/apt/sources.list.d/debian.sources \
        >/etc/apt/sources.list.d/backports.sources \
    && apt-get update \
    && apt-get install -y --no-install-recommends --target-release bookworm-backports mesa-vulkan-drivers \
    && apt-get install -y --no-install-recommends libvulkan1 \
    && rm -rf /var/lib/apt/lists/*
COPY --from=build /relief/target/release/relief /usr/local/bin/relief
USER nobody
EXPOSE 8080
ENTRYPOINT ["relief"]
