OPENBLAS_CORETYPE=Cooperlake b4mrl train --algorithm sac --environment HalfCheetah --simulator hidden-low --history 3 --seed 4 --updates 85000 --eval-every 5000
