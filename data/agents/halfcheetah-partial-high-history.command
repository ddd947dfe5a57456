OPENBLAS_CORETYPE=Cooperlake b4mrl train --algorithm sac --environment HalfCheetah --simulator hidden-high --history 3 --seed 5 --updates 110000 --eval-every 5000
