//! What crosses process borders: nodes, codes and frames over iceoryx2 shared memory.
