# Lets Debian's libcwiid drive a remote that is on the other side of stdin and stdout.
#
# usage: cwiid_host.py FOLDER, which has libcwiid.so.1 and libbluetooth.so.3 somewhere below it
#
# libcwiid takes any two sockets for a remote's channels. What it sends on the control channel is printed as "c HEX", and
# acknowledged as Bluetooth does; lines "i HEX" of stdin go to it on the interrupt channel. Once it has connected, and asked
# for buttons, acceleration and blobs, its state is printed every 50 ms as "s JSON".
import ctypes
import json
import pathlib
import socket
import sys
import threading
import time


class Source(ctypes.Structure):
    _fields_ = [("valid", ctypes.c_char), ("pos", ctypes.c_uint16 * 2), ("size", ctypes.c_int8)]


class State(ctypes.Structure):
    _fields_ = [
        ("rpt_mode", ctypes.c_uint8),
        ("led", ctypes.c_uint8),
        ("rumble", ctypes.c_uint8),
        ("battery", ctypes.c_uint8),
        ("buttons", ctypes.c_uint16),
        ("acc", ctypes.c_uint8 * 3),
        ("ir_src", Source * 4),
        ("rest", ctypes.c_uint8 * 256),
    ]


def library(name):
    return str(next(pathlib.Path(sys.argv[1]).rglob(name)))


ctypes.CDLL(library("libbluetooth.so.3"), ctypes.RTLD_GLOBAL)
cwiid = ctypes.CDLL(library("libcwiid.so.1"))
cwiid.cwiid_new.restype = ctypes.c_void_p
cwiid.cwiid_set_rpt_mode.argtypes = [ctypes.c_void_p, ctypes.c_uint8]
cwiid.cwiid_get_state.argtypes = [ctypes.c_void_p, ctypes.POINTER(State)]

control = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
interrupt = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
printing = threading.Lock()


def say(kind, text):
    with printing:
        print(kind, text, flush=True)


def forward_control():
    while frame := control[1].recv(64):
        control[1].send(b"\x00")
        say("c", frame.hex())


def forward_interrupt():
    for line in sys.stdin:
        if line.startswith("i "):
            interrupt[1].send(bytes.fromhex(line[2:]))


for work in (forward_control, forward_interrupt):
    threading.Thread(target=work, daemon=True).start()

remote = cwiid.cwiid_new(control[0].fileno(), interrupt[0].fileno(), 0)
assert remote, "libcwiid does not connect"
BUTTONS, ACCELERATION, BLOBS = 0x02, 0x04, 0x08
assert cwiid.cwiid_set_rpt_mode(remote, BUTTONS | ACCELERATION | BLOBS) == 0, "libcwiid cannot set the mode"
while True:
    state = State()
    cwiid.cwiid_get_state(remote, ctypes.byref(state))
    blobs = [[s.pos[0], s.pos[1], s.size] if s.valid != b"\x00" else None for s in state.ir_src]
    say("s", json.dumps({"buttons": state.buttons, "acc": list(state.acc), "blobs": blobs}))
    time.sleep(0.05)
