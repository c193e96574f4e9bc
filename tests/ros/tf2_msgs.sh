#!/usr/bin/env bash
# Generate and compile tf2_msgs/TFMessage, which the package index does not have: tf2_msgs.sh VENV; needs gcc.
set -euo pipefail
venv=$(realpath "$1")
read -r site headers < <("$venv/bin/python" -c '
import numpy, sysconfig
print(sysconfig.get_path("purelib"), sysconfig.get_path("include") + ":" + numpy.get_include())')
sources=$(mktemp -d)
trap 'rm -r "$sources"' EXIT
rm -rf "$site"/rosidl_*.egg-info # the wheels name each generator twice, which rosidl refuses
mkdir "$sources/msg"
echo "geometry_msgs/TransformStamped[] transforms" > "$sources/msg/TFMessage.msg"
for kind in "-t c" "-t py" "-ts c" "-ts fastrtps_c" "-ts introspection_c"; do # each in its own directory: names repeat
    # shellcheck disable=SC2086
    AMENT_PREFIX_PATH=$venv "$venv/bin/rosidl" generate $kind -o "$sources/${kind// /}/tf2_msgs" -I "$venv/share" \
        tf2_msgs "$sources:msg/TFMessage.msg" > /dev/null
done
cp -r "$sources/-tpy/tf2_msgs" "$site/"
library=$site/tf2_msgs/tf2_msgs_s__rosidl_typesupport_c.so
cd "$venv/lib"
CPATH="$headers:$venv/include:$(printf '%s:' "$venv"/include/* "$sources"/*)" \
    gcc -shared -fPIC -o "$library" "$sources"/*/tf2_msgs/msg/*.c* "$sources"/*/tf2_msgs/msg/detail/*.c* \
    "$sources"/-tpy/tf2_msgs/_*.rosidl_typesupport_c.c libgeometry_msgs__*_c.so libgeometry_msgs__*_py.so \
    librosidl_*_c.so librosidl_typesupport_fastrtps_cpp.so libfastcdr.so -lstdc++
for support in fastrtps introspection; do
    ln -sf "$library" "libtf2_msgs__rosidl_typesupport_${support}_c.so"
done
