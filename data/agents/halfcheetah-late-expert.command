b4mrl train --algorithm sac --environment HalfCheetah --seed 0 --updates 1380000 --eval-every 60000
