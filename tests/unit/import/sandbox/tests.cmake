unit_test(sandbox test_network Threads::Threads)
