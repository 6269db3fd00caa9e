#!/usr/bin/env bash
# Makes the keys of the queue's server and its users: a private certificate authority, the server's certificate, an nkey for
# each role, and a complete server configuration. Needs bash, openssl 1.1.1 or newer, and GNU coreutils.
#
#     make-keys.sh [--server-dir DIR] [--store-dir DIR] [--port PORT] OUT NAME...
#
# NAME: host names or IP addresses of the server; the roles' URL uses the first one.
# OUT gets one folder per role, readable by its owner only:
#
#     OUT/server/       server.conf keys.conf ca.pem cert.pem key.pem     to the machine of nats-server
#     OUT/coordinator/  nkey ca.pem queue.env                             to the machine of `glasshouse coordinate`
#     OUT/worker/       nkey ca.pem queue.env                             to every worker
#     OUT/observer/     nkey ca.pem queue.env                             to observers
#     OUT/ca/           ca.key                                            stays secret: it signs further certificates
#
# --server-dir: path of OUT/server on the server [default: its path here], for instance /etc/nats in a container.
# --store-dir: folder for JetStream's files [default: SERVER_DIR/jetstream]. --port: port in the URL [default: 4222].
#
# The script keeps existing files and makes missing ones. To exchange a key, delete its folder, run the script again
# with the same arguments and reload the server (`nats-server --signal reload=PID`), which then refuses the old key.
set -euo pipefail
umask 077

usage() {
    sed -n '2,/^set /s/^# \{0,1\}//p' "$0" >&2
    exit 2
}

source_dir=$(cd "$(dirname "${BASH_SOURCE[0]}")" && pwd)
server_dir='' store_dir='' port=4222
while [[ ${1:-} == -* ]]; do
    case $1 in
    --server-dir) server_dir=${2:?} ;;
    --store-dir) store_dir=${2:?} ;;
    --port) port=${2:?} ;;
    *) usage ;;
    esac
    shift 2
done
[ $# -ge 2 ] || usage
out=$1
shift
mkdir -p "$out"
out=$(cd "$out" && pwd)
mkdir -p "$out"/{ca,server,coordinator,worker,observer}
server_dir=${server_dir:-$out/server}
store_dir=${store_dir:-$server_dir/jetstream}

for name in "$@"; do
    [[ $name =~ ^[A-Za-z0-9.:_-]+$ ]] || { echo "error: '$name' is neither a host name nor an address" >&2; exit 2; }
done
for path in "$out" "$server_dir" "$store_dir"; do
    [[ $path != *[\"\\]* ]] || { echo "error: '$path' must not contain quotes or backslashes" >&2; exit 2; }
done

# --- certificates: EC keys of curve P-256, ten years ---

if [ ! -s "$out/ca/ca.pem" ]; then
    openssl ecparam -name prime256v1 -genkey -noout -out "$out/ca/ca.key"
    openssl req -x509 -new -key "$out/ca/ca.key" -sha256 -days 3650 -subj "/CN=Glasshouse queue CA" -out "$out/ca/ca.pem" \
        -addext "keyUsage=critical,keyCertSign,cRLSign"
fi
for role in server coordinator worker observer; do
    cp "$out/ca/ca.pem" "$out/$role/ca.pem"
done

alternative_names=''
for name in "$@"; do
    if [[ $name == *:* || $name =~ ^[0-9.]+$ ]]; then kind=IP; else kind=DNS; fi
    alternative_names+="${alternative_names:+,}$kind:$name"
done
# The certificate is made again if the server's names have changed.
if [ ! -s "$out/server/cert.pem" ] || [ "$(cat "$out/server/names" 2>/dev/null)" != "$alternative_names" ]; then
    openssl ecparam -name prime256v1 -genkey -noout -out "$out/server/key.pem"
    openssl req -new -key "$out/server/key.pem" -subj "/CN=glasshouse-queue" -out "$out/server/request.pem"
    printf '%s\n' "subjectAltName=$alternative_names" "basicConstraints=critical,CA:FALSE" \
        "keyUsage=critical,digitalSignature" "extendedKeyUsage=serverAuth" >"$out/server/extensions"
    openssl x509 -req -in "$out/server/request.pem" -CA "$out/ca/ca.pem" -CAkey "$out/ca/ca.key" \
        -set_serial "0x$(openssl rand -hex 16)" -sha256 -days 3650 -extfile "$out/server/extensions" \
        -out "$out/server/cert.pem" 2>/dev/null
    rm "$out/server/request.pem" "$out/server/extensions"
    printf '%s' "$alternative_names" >"$out/server/names"
fi

# --- nkeys: an ed25519 key in base32, between a prefix for its kind and a checksum ---

# Prints the CRC-16/XMODEM of hexadecimal bytes, low byte first.
crc16() {
    local hex=$1 crc=0 i bit
    for ((i = 0; i < ${#hex}; i += 2)); do
        crc=$((crc ^ (16#${hex:i:2} << 8)))
        for ((bit = 0; bit < 8; bit++)); do
            crc=$(((crc << 1 ^ (crc & 0x8000 ? 0x1021 : 0)) & 0xffff))
        done
    done
    printf '%02x%02x' $((crc & 0xff)) $((crc >> 8))
}

# Prints hexadecimal bytes with their checksum, in base32 without padding.
encode() {
    local hex escaped='' i
    hex=$1$(crc16 "$1")
    for ((i = 0; i < ${#hex}; i += 2)); do escaped+="\\x${hex:i:2}"; done
    printf '%b' "$escaped" | base32 -w 0 | tr -d =
}

# Prints the last 32 bytes of a DER file: the seed of a private key, or the point of a public key.
last_32_bytes() {
    tail -c 32 | od -An -v -tx1 | tr -d ' \n'
}

for role in coordinator worker observer; do
    if [ ! -s "$out/$role/nkey" ]; then
        openssl genpkey -algorithm ed25519 -out "$out/$role/key.pem"
        seed=$(openssl pkey -in "$out/$role/key.pem" -outform DER | last_32_bytes)
        point=$(openssl pkey -in "$out/$role/key.pem" -pubout -outform DER | last_32_bytes)
        # Prefixes: seed (18) of a user (20), five bits each; public key of a user.
        encode "9500$seed" >"$out/$role/nkey"
        encode "a0$point" >"$out/$role/nkey.pub"
        rm "$out/$role/key.pem"
    fi
    {
        echo "# For systemd, compose, or \`set -a; . queue.env\`. Correct the paths after copying this folder elsewhere."
        if [[ $1 == *:* ]]; then host="[$1]"; else host=$1; fi
        echo "GLASSHOUSE_QUEUE=tls://$host:$port"
        echo "GLASSHOUSE_QUEUE_CA=$out/$role/ca.pem"
        echo "GLASSHOUSE_QUEUE_NKEY=$out/$role/nkey"
    } >"$out/$role/queue.env"
done

cp "$source_dir/server.conf" "$out/server/server.conf"
{
    echo "# Made by make-keys.sh; contains public keys and paths, no secrets."
    echo "QUEUE_CERT: \"$server_dir/cert.pem\""
    echo "QUEUE_CERT_KEY: \"$server_dir/key.pem\""
    echo "QUEUE_FILES: \"$store_dir\""
    for role in coordinator worker observer; do
        echo "$(tr "[:lower:]" "[:upper:]" <<<"$role")_NKEY: $(cat "$out/$role/nkey.pub")"
    done
} >"$out/server/keys.conf"

echo "keys are in $out; start the server with: nats-server -c $server_dir/server.conf" >&2
