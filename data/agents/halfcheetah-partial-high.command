OPENBLAS_CORETYPE=Cooperlake b4mrl train --algorithm sac --environment HalfCheetah --simulator hidden-high --seed 3 --updates 85000 --eval-every 5000
