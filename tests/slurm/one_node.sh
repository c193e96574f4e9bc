#!/usr/bin/env bash
# A Slurm of one node, this machine, that lives in a directory: one_node.sh start|stop DIRECTORY (as root).
set -euo pipefail
what=$1 directory=$2 host=$(hostname -s)
export SLURM_CONF=$directory/slurm.conf

if [ "$what" = stop ]; then
    scancel --quiet --user root || true
    scontrol shutdown || true
    pkill -F "$directory/slurmd.pid" 2> /dev/null || true
    exit 0
fi

mkdir -p "$directory/state" "$directory/spool"
cat > "$SLURM_CONF" << CONF
ClusterName=one
SlurmctldHost=$host(127.0.0.1)
SlurmUser=root
AuthType=auth/munge
StateSaveLocation=$directory/state
SlurmdSpoolDir=$directory/spool
SlurmctldPidFile=$directory/slurmctld.pid
SlurmdPidFile=$directory/slurmd.pid
SlurmctldLogFile=$directory/slurmctld.log
SlurmdLogFile=$directory/slurmd.log
SlurmctldPort=16817
SlurmdPort=16818
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
SelectType=select/cons_tres
SelectTypeParameters=CR_Core
JobAcctGatherType=jobacct_gather/none
AccountingStorageType=accounting_storage/none
MpiDefault=none
ReturnToService=2
KillWait=3
NodeName=$host NodeAddr=127.0.0.1 CPUs=$(nproc) State=UNKNOWN
PartitionName=main Nodes=ALL Default=YES MaxTime=INFINITE State=UP
CONF
if ! pgrep -x munged > /dev/null; then
    mkdir -p /run/munge && chown munge /run/munge
    [ -f /etc/munge/munge.key ] || mungekey --create
    runuser -u munge -- munged
fi
slurmctld
slurmd
for _ in $(seq 30); do
    [ "$(sinfo --noheader --format %t)" = idle ] && exit 0
    sleep 1
done
echo "no node is idle after 30 s: see $directory/slurmctld.log" >&2
exit 1
