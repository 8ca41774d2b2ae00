#!/bin/sh
# Become the first process of a machine of its own: a systemd over a copy of this file system that nothing keeps.
# Started by tests/support/booted.py in new mount, process, network, host name, IPC and cgroup namespaces.
# usage: boot.sh FOLDER CHECKOUT PYTHON'S-PREFIX PYTHON'S-NAME SITE-PACKAGES
set -eu
folder=$1 checkout=$2 prefix=$3 python=$4 packages=$5
mount --make-rprivate /
mount -t tmpfs tmpfs "$folder"
mkdir "$folder/upper" "$folder/work" "$folder/root"
root=$folder/root
mount -t overlay overlay -o "lowerdir=/,upperdir=$folder/upper,workdir=$folder/work" "$root"
mount -t proc proc "$root/proc"
mount -t sysfs -o ro sysfs "$root/sys"
mount -t tmpfs tmpfs "$root/run"
mount -t tmpfs tmpfs "$root/tmp"
mount -t tmpfs -o mode=755 tmpfs "$root/dev"
for node in null:1:3 zero:1:5 full:1:7 random:1:8 urandom:1:9 tty:5:0; do
  name=${node%%:*} numbers=${node#*:}
  mknod -m 666 "$root/dev/$name" c "${numbers%:*}" "${numbers#*:}"
done
mkdir "$root/dev/pts" "$root/dev/shm"
mount -t devpts -o newinstance,ptmxmode=666 devpts "$root/dev/pts"
mount -t tmpfs tmpfs "$root/dev/shm"
ln -s pts/ptmx "$root/dev/ptmx"
ln -s /proc/self/fd "$root/dev/fd"

if [ -e /sys/fs/cgroup/cgroup.controllers ]; then
  mount -t cgroup2 cgroup2 "$root/sys/fs/cgroup"
else
  mount -t tmpfs -o mode=755 tmpfs "$root/sys/fs/cgroup"
  mkdir "$root/sys/fs/cgroup/unified" "$root/sys/fs/cgroup/systemd"
  mount -t cgroup2 cgroup2 "$root/sys/fs/cgroup/unified"
  mount -t cgroup -o none,name=systemd cgroup "$root/sys/fs/cgroup/systemd"
  for controller in memory pids devices; do
    mkdir "$root/sys/fs/cgroup/$controller"
    mount -t cgroup -o $controller cgroup "$root/sys/fs/cgroup/$controller"
  done
  mount -o remount,ro "$root/sys/fs/cgroup"
fi

# Nothing of what this machine itself would start belongs here.
rm -rf "$root/etc/systemd/system" "$root/etc/fstab" "$root/var/log/journal"
mkdir -p "$root/etc/systemd/system"
cp /dev/null "$root/etc/fstab"
for unit in timers.target getty.target cron.service dbus.socket dbus.service avahi-daemon.socket systemd-udevd.service \
  systemd-udevd-kernel.socket systemd-udevd-control.socket systemd-udev-trigger.service systemd-modules-load.service \
  systemd-remount-fs.service systemd-sysctl.service systemd-update-utmp.service systemd-sysusers.service \
  systemd-tmpfiles-setup-dev.service dev-hugepages.mount dev-mqueue.mount sys-kernel-debug.mount \
  sys-kernel-tracing.mount sys-fs-fuse-connections.mount systemd-ask-password-console.path systemd-initctl.socket \
  modprobe@.service; do
  ln -s /dev/null "$root/etc/systemd/system/$unit"
done
cat > "$root/etc/systemd/system/machine.target" <<'END'
[Unit]
Requires=basic.target
After=basic.target
AllowIsolate=yes
END

# Argosy where a board has it. Checkout and Python may stand where services do not look, such as a home.
mkdir -p "$root/opt/checkout" "$root/opt/python" "$root/opt/packages" "$root/opt/argosy/bin"
mount --bind "$checkout" "$root/opt/checkout"
mount --bind "$prefix" "$root/opt/python"
mount --bind "$packages" "$root/opt/packages"
cat > "$root/opt/argosy/bin/python" <<END
#!/bin/sh
export PYTHONPATH=/opt/checkout:/opt/packages LD_LIBRARY_PATH=/opt/python/lib PYTHONDONTWRITEBYTECODE=1
exec /opt/python/bin/$python "\$@"
END
chmod 755 "$root/opt/argosy/bin/python"
for name in commd bridged agentd argosy; do
  cat > "$root/opt/argosy/bin/$name" <<END
#!/bin/sh
exec /opt/argosy/bin/python -P -m $name "\$@"
END
  chmod 755 "$root/opt/argosy/bin/$name"
done

ip link set lo up
# Not chroot: in one the kernel makes no user namespaces (PrivateUsers=).
mkdir "$root/old"
cd "$root"
pivot_root . old
umount -l /old
rmdir /old
exec env -i container=argosy-test PATH=/usr/sbin:/usr/bin:/sbin:/bin /lib/systemd/systemd \
  --system --unit=machine.target --log-target=null --show-status=no
