b4mrl train --algorithm sac --environment HalfCheetah --seed 1 --updates 300000 --stop-at-score 40 --out halfcheetah-medium
