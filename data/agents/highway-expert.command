OPENBLAS_CORETYPE=Cooperlake b4mrl train --algorithm sac --environment Highway --seed 0 --updates 300000 --eval-every 5000 --out highway, its agent.h5 after 80,000 updates
