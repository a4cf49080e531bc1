# Makes programs of this shell use what scripts/setup-driver and scripts/setup-peers put under .relief.
#
# usage: . scripts/env.sh       (in bash; in another shell, from the project's folder)
#
# Sets VK_DRIVER_FILES to the pinned software driver, LD_LIBRARY_PATH to the libraries unpacked with it, and
# RELIEF_PEERS_PYTHON to the Python that has the peers, RELIEF_CWIID to libcwiid, RELIEF_SLICER to a folder for PYTHONPATH with
# 3D Slicer's core, RELIEF_OHIF to OHIF's reader, RELIEF_DICOM_TOOLS to dsrdump and dciodvfy, RELIEF_SLURM to Slurm's programs, RELIEF_NATS_SERVER,
# RELIEF_MOTO, RELIEF_NGINX and RELIEF_ORTHANC (a folder of programs) to those of scripts/setup-services, RELIEF_DEBIAN_ROOT to a clean
# Debian, RELIEF_WITH_KERNEL to what runs a command on a kernel of its own; of scripts/setup-ipopt it sets what building with the feature `ipopt` and running it needs. What is not set up is left out. A VK_DRIVER_FILES or VK_ICD_FILENAMES that is already set wins. On a machine with a graphics card the driver is added to the
# system's own (VK_ADD_DRIVER_FILES) and so does not hide the card; RELIEF_DRIVER=pinned takes the software
# driver even then.
# shellcheck shell=sh disable=SC3028,SC3054,SC2128

relief_root=$(cd -- "$(dirname -- "${BASH_SOURCE:-scripts/env.sh}")/.." && pwd)

relief_add_libraries() {
    case ":${LD_LIBRARY_PATH:-}:" in
    *":$1:"*) ;;
    *) export LD_LIBRARY_PATH="$1${LD_LIBRARY_PATH:+:$LD_LIBRARY_PATH}" ;;
    esac
}

relief_has_card() { [ -e /dev/nvidiactl ] || [ -n "$(find /dev/dri -name 'renderD*' 2>/dev/null)" ]; }

relief_icd=$relief_root/.relief/driver/lvp_icd.json
if [ -f "$relief_icd" ]; then
    relief_add_libraries "$relief_root/.relief/driver/lib"
    if [ "${VK_DRIVER_FILES:-}" = "$relief_icd" ]; then
        : # sourced before
    elif [ -n "${VK_DRIVER_FILES:-}${VK_ICD_FILENAMES:-}" ]; then
        echo "relief: keeping the Vulkan driver that the environment names: ${VK_DRIVER_FILES:-${VK_ICD_FILENAMES:-}}" >&2
    elif [ "${RELIEF_DRIVER:-}" != pinned ] && relief_has_card; then
        export VK_ADD_DRIVER_FILES="$relief_icd"
    else
        export VK_DRIVER_FILES="$relief_icd"
    fi
fi

if [ -f "$relief_root/.relief/peers/stamp" ]; then
    export RELIEF_PEERS_PYTHON="$relief_root/.relief/peers/bin/python"
    # VTK's GPU mapper draws in memory, without a window system.
    export VTK_DEFAULT_OPENGL_WINDOW="${VTK_DEFAULT_OPENGL_WINDOW:-vtkOSOpenGLRenderWindow}"
fi
if [ -f "$relief_root/.relief/cwiid/stamp" ]; then
    export RELIEF_CWIID="$relief_root/.relief/cwiid"
fi
if [ -f "$relief_root/.relief/slicer/stamp" ]; then
    export RELIEF_SLICER="$relief_root/.relief/slicer"
fi
if [ -f "$relief_root/.relief/ohif/stamp" ]; then
    export RELIEF_OHIF="$relief_root/.relief/ohif"
fi
if [ -f "$relief_root/.relief/dicom-tools/stamp" ]; then
    export RELIEF_DICOM_TOOLS="$relief_root/.relief/dicom-tools/bin"
fi
if [ -f "$relief_root/.relief/postgres/stamp" ]; then
    export RELIEF_POSTGRES="$relief_root/.relief/postgres/bin"
fi
if [ -f "$relief_root/.relief/slurm/stamp" ]; then
    export RELIEF_SLURM="$relief_root/.relief/slurm/bin"
fi
if [ -f "$relief_root/.relief/services/stamp" ]; then
    export RELIEF_NATS_SERVER="$relief_root/.relief/services/bin/nats-server"
    export RELIEF_MOTO="$relief_root/.relief/services/bin/moto_server"
    export RELIEF_MANIFESTS_PYTHON="$relief_root/.relief/services/bin/python"
fi
if [ -f "$relief_root/.relief/nginx/stamp" ]; then
    export RELIEF_NGINX="$relief_root/.relief/nginx/bin/nginx"
fi
if [ -f "$relief_root/.relief/orthanc/stamp" ]; then
    export RELIEF_ORTHANC="$relief_root/.relief/orthanc/bin"
fi
if [ -f "$relief_root/.relief/debian-root/stamp" ]; then
    export RELIEF_DEBIAN_ROOT="$relief_root/.relief/debian-root"
fi
if [ -f "$relief_root/.relief/kernel/stamp" ]; then
    export RELIEF_WITH_KERNEL="$relief_root/scripts/with-kernel"
fi
if [ -f "$relief_root/.relief/osmesa/stamp" ]; then
    relief_add_libraries "$relief_root/.relief/osmesa/lib"
fi

if [ -f "$relief_root/.relief/ipopt/stamp" ]; then
    relief_add_libraries "$relief_root/.relief/ipopt/lib"
    case ":${PKG_CONFIG_PATH:-}:" in
    *":$relief_root/.relief/ipopt/pkgconfig:"*) ;;
    *) export PKG_CONFIG_PATH="$relief_root/.relief/ipopt/pkgconfig${PKG_CONFIG_PATH:+:$PKG_CONFIG_PATH}" ;;
    esac
    export LIBCLANG_PATH="$relief_root/.relief/ipopt/lib"
    if [ -d "$relief_root/.relief/ipopt/include/openssl" ]; then
        export OPENSSL_LIB_DIR="$relief_root/.relief/ipopt/lib" OPENSSL_INCLUDE_DIR="$relief_root/.relief/ipopt/include"
    fi
fi

unset relief_root relief_icd
unset -f relief_add_libraries relief_has_card
