OPENBLAS_CORETYPE=Cooperlake b4mrl train --algorithm sac --environment HalfCheetah --simulator hidden-low --seed 2 --updates 50000 --eval-every 5000
