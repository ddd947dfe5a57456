# A Slurm cluster of two nodes on this machine, for the user who sources this file. No service, no
# privilege, no cgroup is needed, and nothing of it is left in the end.
#
#   start_cluster FOLDER   the controller and the nodes n1 and n2 with two processors each; configuration,
#                          logs and state are in FOLDER
#   address_of_host        must not be empty
#   start_node n2          starts the node's slurmd, again after it was killed
#   stop_cluster
#
# After start_cluster, `slurmd_n1` and `slurmd_n2` are the ids of the nodes' processes. Needs ../wait_for.sh.

start_cluster() {
  cluster=$1
  mkdir -p "$cluster/state" "$cluster/spool.n1" "$cluster/spool.n2" || exit 1
  local host address user ports
  host=$(hostname -s)
  # Slurm listens where the name leads, which on a fresh Debian is 127.0.1.1.
  address=$(address_of_host)
  user=$(id -un)
  # Free ports below those that the system gives to clients, which could take them meanwhile.
  ports=($(python3 - "$address" <<'PYTHON'
import random, socket, sys
free = []
while len(free) < 3:
    port = random.randrange(20000, 32000)
    with socket.socket() as probe:
        if port not in free and probe.connect_ex((sys.argv[1], port)) != 0:
            free.append(port)
print(*free)
PYTHON
  ))
  export SLURM_CONF=$cluster/slurm.conf
  # cred_expire: requeued jobs wait as long. config_overrides: nodes may claim processors that are not there.
  cat >"$SLURM_CONF" <<CONF
ClusterName=test
SlurmctldHost=$host($address)
SlurmctldPort=${ports[0]}
SlurmUser=$user
SlurmdUser=$user
AuthType=auth/none
CredType=cred/none
AuthInfo=cred_expire=5
StateSaveLocation=$cluster/state
SlurmdSpoolDir=$cluster/spool.%n
SlurmctldPidFile=$cluster/slurmctld.pid
SlurmdPidFile=$cluster/slurmd.%n.pid
SlurmctldLogFile=$cluster/slurmctld.log
SlurmdLogFile=$cluster/slurmd.%n.log
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
JobAcctGatherType=jobacct_gather/none
SwitchType=switch/none
MpiDefault=none
SelectType=select/cons_tres
SelectTypeParameters=CR_CPU
SlurmdParameters=config_overrides
ReturnToService=2
PropagateResourceLimits=NONE
KillWait=5
SlurmdTimeout=10
BatchStartTimeout=10
MessageTimeout=10
SchedulerParameters=batch_sched_delay=0,sched_interval=1,bf_interval=1
JobCompType=jobcomp/none
CommunicationParameters=NoInAddrAny,NoCtldInAddrAny
NodeName=n1 NodeHostname=$host NodeAddr=$address Port=${ports[1]} CPUs=2 RealMemory=64000 Weight=2
NodeName=n2 NodeHostname=$host NodeAddr=$address Port=${ports[2]} CPUs=2 RealMemory=64000 Weight=1
PartitionName=p Nodes=ALL Default=YES
CONF
  slurmctld -D -c -f "$SLURM_CONF" >"$cluster/slurmctld.out" 2>&1 &
  slurmctld=$!
  start_node n1
  start_node n2
  wait_for 60 "both nodes are ready" both_ready
}

# The IPv4 address of this machine's name; "" if it has none.
address_of_host() { getent ahostsv4 "$(hostname -s)" | awk '{ print $1; exit }'; }

both_ready() { [ "$(sinfo -h -t idle -o %D)" = 2 ]; }

start_node() {
  slurmd -D -N "$1" -f "$SLURM_CONF" >>"$cluster/slurmd.$1.out" 2>&1 &
  declare -g "slurmd_$1=$!"
  disown  # the shell is not to report that it was killed
}

# Ends what start_cluster and start_node began, by id, and the steps of tasks that outlive their node.
stop_cluster() {
  [ -n "${slurmctld:-}" ] || return 0
  timeout 10 scancel --user="$(id -un)" 2>/dev/null
  local end=$((SECONDS + 15)) id
  while [ $SECONDS -lt $end ] && [ -n "$(timeout 5 squeue -h 2>/dev/null)" ]; do sleep 0.2; done
  for id in $slurmd_n1 $slurmd_n2 $slurmctld; do kill -TERM "$id" 2>/dev/null; done
  end=$((SECONDS + 10))
  for id in $slurmd_n1 $slurmd_n2 $slurmctld; do
    while [ $SECONDS -lt $end ] && kill -0 "$id" 2>/dev/null; do sleep 0.1; done
    kill -KILL "$id" 2>/dev/null
  done
  slurmctld=
}
