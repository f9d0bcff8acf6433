"""Publishers, subscriptions, serialised messages, domains, shared memory of Fast DDS."""
