OPENBLAS_CORETYPE=Cooperlake b4mrl train --algorithm sac --environment Hopper --seed 0 --updates 140000 --eval-every 5000
