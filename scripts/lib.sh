# Shared by the scripts of this folder; sourced, never run.
#
# Messages, the project's private folder (.relief, ignored by git), installing with apt, and unpacking Debian
# packages privately. Everything that this library writes is under .relief, but for `install_packages`, which
# installs with apt and says so.
# shellcheck shell=bash

RELIEF_ROOT=$(cd -- "$(dirname -- "${BASH_SOURCE[0]}")/.." && pwd)
RELIEF_PRIVATE=$RELIEF_ROOT/.relief
RELIEF_SHARED=$RELIEF_ROOT/../shared # test data and peers' tools; not part of a release
PINS=$RELIEF_ROOT/scripts/debian-pins.txt

# Messages go to stderr, so that stdout carries only results.
say() { printf '%s: %s\n' "${0##*/}" "$*" >&2; }
warn() { printf '%s: WARNING: %s\n' "${0##*/}" "$*" >&2; }
die() {
    printf '%s: %s\n' "${0##*/}" "$*" >&2
    exit 1
}

# The head comment of the running script, as its help.
print_help() { awk 'NR > 1 && !/^#/ { exit } NR > 1 { sub(/^# ?/, ""); print }' "$0"; }

# For scripts without options: --help, or nothing.
refuse_arguments() {
    case "${1:-}" in
    '') ;;
    -h | --help) print_help && exit 0 ;;
    *)
        printf '%s: unknown argument: %s (see --help)\n' "${0##*/}" "$1" >&2
        exit 2
        ;;
    esac
}

have() { command -v "$1" >/dev/null 2>&1; }

# A field of the system's description; RELIEF_OS_RELEASE names another file, to try what other systems do.
os_field() { (
    # shellcheck disable=SC1090
    . "${RELIEF_OS_RELEASE:-/etc/os-release}" 2>/dev/null && eval "printf '%s' \"\${$1:-}\""
) || true; }

is_debian_12() { [ "$(os_field ID) $(os_field VERSION_ID)" = "debian 12" ] && have apt-get && have dpkg-deb; }

# Holds a lock of this name until the script ends, so that two runs at once do not disturb each other.
take_lock() {
    mkdir -p "$RELIEF_PRIVATE"
    exec 9>"$RELIEF_PRIVATE/$1.lock"
    flock 9
}

# Installs packages with apt, as root or by sudo without a password; where it cannot, fails and says what to run.
install_packages() {
    local as_root=()
    if ! have apt-get; then
        say "this system has no apt-get; install what these Debian packages hold: $*"
        return 1
    fi
    if [ "$(id -u)" != 0 ]; then
        if ! have sudo || ! sudo -n true 2>/dev/null; then
            say "root is needed to install packages. Run: sudo apt-get install $*"
            return 1
        fi
        as_root=(sudo -n)
    fi
    say "installing with apt: $*"
    # A fresh machine has no package lists, an old one has stale ones: they are refreshed when a try fails.
    local install=("${as_root[@]}" env DEBIAN_FRONTEND=noninteractive)
    install+=(apt-get -q -y --no-install-recommends install "$@")
    if "${install[@]}" >/dev/null 2>&1; then return 0; fi
    if "${as_root[@]}" apt-get -q update >&2 && "${install[@]}" >&2; then return 0; fi
    say "apt could not install: $*"
    return 1
}

# Field FIELD (2: version, 4: SHA-256) of PACKAGE in the table of pins, for this architecture.
pin() { # PACKAGE FIELD
    awk -v package="$1" -v field="$2" -v arch="$(dpkg --print-architecture)" \
        '$1 == package && ($3 == arch || $3 == "all") { print $field }' "$PINS"
}

# One line of apt sources for each Debian suite that this machine is configured with, and one for backports at
# the place of bookworm itself. No address of an archive is written down in the project.
debian_sources() {
    local options='' keyring=/usr/share/keyrings/debian-archive-keyring.gpg uri release component target
    if [ -f "$keyring" ]; then options="[signed-by=$keyring]"; fi
    # shellcheck disable=SC2016  # these are fields of apt's format, not variables
    apt-get indextargets --no-release-info \
        --format '$(REPO_URI)|$(RELEASE)|$(COMPONENT)|$(TARGET_OF)' 'Created-By: Packages' |
        sort -u | while IFS='|' read -r uri release component target; do
        case "$target,$uri,$release" in
        deb,cdrom:*) ;;
        deb,*,bookworm | deb,*,bookworm-updates | deb,*,bookworm-security)
            printf 'deb %s %s %s %s\n' "$options" "$uri" "$release" "$component"
            ;;
        esac
        if [ "$target,$release,$component" = deb,bookworm,main ]; then
            printf 'deb %s %s bookworm-backports main\n' "$options" "$uri"
        fi
    done
}

# apt-get with its lists and caches under FOLDER, as if nothing were installed: needs no root, changes nothing.
private_apt() { # FOLDER ARGUMENT...
    local folder=$1
    shift
    apt-get -q -c "$folder/apt.conf" \
        -o Dir::Etc::SourceList="$folder/sources.list" -o Dir::Etc::SourceParts=/dev/null \
        -o Dir::Etc::Preferences=/dev/null -o Dir::Etc::PreferencesParts=/dev/null \
        -o Dir::State::Lists="$folder/lists" -o Dir::State::Status=/dev/null \
        -o Dir::State::Extended_States="$folder/extended_states" -o Dir::Cache="$folder/cache" "$@"
}

make_private_apt() { # FOLDER
    mkdir -p "$1/lists/partial" "$1/cache/archives/partial"
    debian_sources >"$1/sources.list"
    if ! grep -q bookworm-backports "$1/sources.list"; then
        say "the machine's apt configuration has no bookworm main, so the address of its backports is not known"
        return 1
    fi
    # The hooks of the machine's own configuration are about the machine's own lists.
    cat >"$1/apt.conf" <<'CONF'
#clear APT::Update::Pre-Invoke;
#clear APT::Update::Post-Invoke;
#clear APT::Update::Post-Invoke-Success;
APT::Sandbox::User "";
Acquire::Languages "none";
Acquire::IndexTargets::deb::DEP-11::DefaultEnabled "false";
Debug::NoLocking "true";
CONF
    private_apt "$1" update >"$1/update.log" 2>&1 || {
        cat "$1/update.log" >&2
        return 1
    }
}

# Downloads packages into WORK/debs in the archive's versions, which may be older than those of installed ones.
download_packages() { # WORK PACKAGE...
    local work=$1
    shift
    mkdir -p "$work/apt" "$work/debs"
    make_private_apt "$work/apt" || return 1
    (cd "$work/debs" && private_apt "$work/apt" download "$@" >"$work/apt/download.log" 2>&1) || {
        cat "$work/apt/download.log" >&2
        return 1
    }
}

# NAME=VERSION of every package that the requested ones need, whether or not this machine has it: a private folder
# that lacks what happens to be installed stops working when that is removed. The C library and the compiler's
# libraries belong to every program and are never replaced.
needed_packages() { # FOLDER REQUEST...
    local folder=$1 name version
    shift
    private_apt "$folder" -s --no-install-recommends install "$@" >"$folder/plan.log" 2>&1 || {
        cat "$folder/plan.log" >&2
        return 1
    }
    sed -n 's/^Inst \([^ ]*\) (\([^ ]*\) .*/\1 \2/p' "$folder/plan.log" | while read -r name version; do
        case "$name" in libc6 | libgcc-s1 | libstdc++6 | gcc-*-base | *-data) continue ;; esac
        printf '%s=%s\n' "$name" "$version"
    done
}

# Every downloaded package of the table of pins has the SHA-256 that stands there.
check_pins() { # FOLDER_OF_DEBS
    local deb name expected found
    for deb in "$1"/*.deb; do
        name=$(basename "$deb")
        name=${name%%_*}
        expected=$(pin "$name" 4)
        if [ -z "$expected" ]; then continue; fi # of Debian's stable suite: apt has checked its signature
        found=$(sha256sum "$deb" | cut -d ' ' -f 1)
        if [ "$found" != "$expected" ]; then
            say "$name $(pin "$name" 2) has SHA-256 $found, expected $expected; it is not used"
            return 1
        fi
    done
}

# Puts the shared libraries of a pinned package, of the others and of their dependencies into TARGET/lib. The
# system's own packages stay unchanged. TARGET appears whole or not at all.
unpack_pinned() { # TARGET PACKAGE...
    local target=$1 work package version requests=() needed
    shift
    if [ -z "$(pin "$1" 2)" ]; then
        say "no checksum of $1 is known for $(dpkg --print-architecture)"
        return 1
    fi
    for package in "$@"; do
        version=$(pin "$package" 2)
        requests+=("$package${version:+=$version}")
    done
    mkdir -p "$RELIEF_PRIVATE"
    work=$(mktemp -d "$RELIEF_PRIVATE/unpack.XXXXXX")
    # shellcheck disable=SC2064
    trap "rm -rf '$work'" EXIT
    mkdir -p "$work/apt" "$work/debs" "$work/root" "$work/new/lib"
    make_private_apt "$work/apt" || return 1
    needed=$(needed_packages "$work/apt" "${requests[@]}") || return 1
    # shellcheck disable=SC2086
    (cd "$work/debs" && private_apt "$work/apt" download $needed >"$work/apt/download.log" 2>&1) || {
        cat "$work/apt/download.log" >&2
        return 1
    }
    check_pins "$work/debs" || return 1
    for package in "$work/debs"/*.deb; do dpkg-deb -x "$package" "$work/root" || return 1; done
    # Packages keep libraries under /usr/lib or, from before these two were merged, under /lib.
    find "$work/root" -path '*/lib/*-linux-gnu/*.so*' -exec mv -t "$work/new/lib" {} + || return 1
    rm -rf "$target"
    mv -T "$work/new" "$target"
    rm -rf "$work"
}

# Unpacks a series of the shared test data, once, or takes that of scripts/setup-samples; prints its folder.
unpack_series() { # NAME
    local archive=$RELIEF_SHARED/data/$1.tar.xz folder=$RELIEF_PRIVATE/data/$1 work
    if [ ! -d "$folder" ] && [ ! -f "$archive" ] && [ -d "$RELIEF_PRIVATE/samples/$1" ]; then folder=$RELIEF_PRIVATE/samples/$1; fi
    if [ ! -d "$folder" ]; then
        [ -f "$archive" ] || die "the series $1 is needed, but ../shared/data/$1.tar.xz is not there (scripts/setup-samples has others)"
        mkdir -p "$RELIEF_PRIVATE/data"
        work=$(mktemp -d "$RELIEF_PRIVATE/data/unpack.XXXXXX")
        tar -xJf "$archive" -C "$work" || { rm -rf "$work" && die "cannot unpack $archive"; }
        # Another run may have been faster; its copy is as good.
        mv -T "$work/$1" "$folder" 2>/dev/null || [ -d "$folder" ] || die "cannot write $folder"
        rm -rf "$work"
    fi
    printf '%s\n' "$folder"
}

# Builds the release binary; prints its path.
build_release() {
    if [ -n "${RELIEF_PROGRAM:-}" ]; then
        printf '%s\n' "$RELIEF_PROGRAM"
        return
    fi
    (cd "$RELIEF_ROOT" && cargo build --release --locked --features full >&2) || die "relief does not build"
    printf '%s/release/relief\n' "$(target_folder)"
}

target_folder() { printf '%s\n' "${CARGO_TARGET_DIR:-$RELIEF_ROOT/target}"; }
