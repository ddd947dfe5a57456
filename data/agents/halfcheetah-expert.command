OPENBLAS_CORETYPE=Cooperlake b4mrl train --algorithm sac --environment HalfCheetah --seed 1 --updates 800000
